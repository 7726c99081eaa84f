"""Live sessions: sources of samples, one session that runs a method over them, and sinks for its poses."""
