"""What is clicked, beside the picture: one file for each panel, and the table of them."""

from tcfit_app.panels.compare import ComparePanel
from tcfit_app.panels.export import ExportPanel
from tcfit_app.panels.fit import FitPanel
from tcfit_app.panels.keypoints import KeypointsPanel
from tcfit_app.panels.panel import Panel
from tcfit_app.panels.review import ReviewPanel
from tcfit_app.panels.runs import RunsPanel
from tcfit_app.panels.start import StartPanel
from tcfit_app.panels.view import ViewPanel

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
