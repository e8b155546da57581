"""The tcfit app: command line, and later the browser app, around fitting_core."""
