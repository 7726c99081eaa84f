"""How far an estimated motion is from the true one: metrics, their rows, and the loop over sequences and methods."""
