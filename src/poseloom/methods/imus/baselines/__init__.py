"""Earlier ways from one or two IMUs to full-body motion, to compare the phase HMM with: fitted to the same pairs."""
