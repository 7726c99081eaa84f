"""How fast things are, measured the same way each time."""
