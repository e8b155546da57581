"""Clips of known truth, and the method measured on them. Not installed."""
