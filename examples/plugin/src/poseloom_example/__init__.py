"""A method, a source and a motion file format for poseloom, each one file and one entry point."""
