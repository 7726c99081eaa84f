"""Skeletons, the body, poses and motions, and their kinematics."""
