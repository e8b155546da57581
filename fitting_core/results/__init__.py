"""Data of a fit's result and of its given start."""
