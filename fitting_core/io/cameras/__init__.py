"""Calibrated cameras from other programs' files: one module per layout, and reading.py, which tells them apart."""
