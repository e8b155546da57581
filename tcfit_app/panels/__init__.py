"""What is clicked, beside the picture: one file for each panel, and the table of them."""

from tcfit_app.panels.keypoints import KeypointsPanel
from tcfit_app.panels.panel import Panel
from tcfit_app.panels.review import ReviewPanel
from tcfit_app.panels.view import ViewPanel

PANELS: tuple[type[Panel], ...] = (
    ViewPanel,
    KeypointsPanel,
    ReviewPanel,
)
"""In the order of their tabs."""
