"""What is clicked, beside the picture: one file for each panel, and the table of them."""

from tcfit_app.review.panels.compare.compare_panel import ComparePanel
from tcfit_app.review.panels.elements.panel import Panel
from tcfit_app.review.panels.export_panel import ExportPanel
from tcfit_app.review.panels.fit.fit_panel import FitPanel
from tcfit_app.review.panels.keypoints.keypoints_panel import KeypointsPanel
from tcfit_app.review.panels.review_panel import ReviewPanel
from tcfit_app.review.panels.runs.runs_panel import RunsPanel
from tcfit_app.review.panels.start_panel import StartPanel
from tcfit_app.review.panels.view_panel import ViewPanel

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
