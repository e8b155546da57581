"""What is clicked, beside the picture: one file for each panel, and the table of them."""

from tcfit_app.panels.compare import ComparePanel
from tcfit_app.panels.export import ExportPanel
from tcfit_app.panels.fit import FitPanel
from tcfit_app.panels.panel import Panel
from tcfit_app.panels.runs import RunsPanel

PANELS: tuple[type[Panel], ...] = (
    FitPanel,
    RunsPanel,
    ComparePanel,
    ExportPanel,
)  # fmt: skip
"""In the order of their tabs."""
