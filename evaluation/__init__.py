"""Clips of known truth, and how well the method does on them. Not installed: for whoever works on the method."""
