"""Where poses go: to other programs, to files, to people."""
