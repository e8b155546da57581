"""What is clicked, beside the picture: one file for each panel, and the table of them."""

from tcfit_app.review.panels.compare.panel import ComparePanel
from tcfit_app.review.panels.elements.panel import Panel
from tcfit_app.review.panels.export import ExportPanel
from tcfit_app.review.panels.fit.panel import FitPanel
from tcfit_app.review.panels.keypoints.panel import KeypointsPanel
from tcfit_app.review.panels.review import ReviewPanel
from tcfit_app.review.panels.runs.panel import RunsPanel
from tcfit_app.review.panels.start import StartPanel
from tcfit_app.review.panels.view import ViewPanel

PANELS: tuple[type[Panel], ...] = (
    ViewPanel,
    KeypointsPanel,
    ReviewPanel,
    FitPanel,
    RunsPanel,
    ComparePanel,
    ExportPanel,
)
"""In the order of their tabs."""
WITHOUT_KEYPOINTS: tuple[type[Panel], ...] = (StartPanel, *PANELS)
"""Of a project without keypoints."""
