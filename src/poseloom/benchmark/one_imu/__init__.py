"""The single-IMU paper's experiments: table 2, table 3, figure 10, transitions, phases, drop-outs, a real walk."""
