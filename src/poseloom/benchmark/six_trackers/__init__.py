"""The six-sensor paper's experiments: which sequences, on what they are run, and each of its tables and figures."""
