"""`python -m poseloom`."""

from poseloom.cli import main

main()
