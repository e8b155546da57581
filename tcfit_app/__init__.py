"""The tcfit app: the command line and the browser app around fitting_core."""
