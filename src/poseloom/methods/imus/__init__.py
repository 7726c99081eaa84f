"""Full-body motion from one to three IMUs: training pairs, phases, registration and the phase HMM."""
