"""What is clicked, beside the picture: one file for each panel, and the table of them."""

from tcfit_app.panels.fit import FitPanel
from tcfit_app.panels.panel import Panel

PANELS: tuple[type[Panel], ...] = (
    FitPanel,
)  # fmt: skip
"""In the order of their tabs."""
