"""What is clicked, beside the picture: one file for each panel, and the table of them."""

from tcfit_app.panels.panel import Panel

PANELS: tuple[type[Panel], ...] = ()
"""In the order of their tabs."""
