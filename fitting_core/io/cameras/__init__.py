"""Calibrated cameras in the files of others: one file for each layout, and reading.py, which tells them apart."""
