"""The live path under load and under faults, measured on this machine."""
