"""What is clicked, beside the picture: one file for each panel, and the table of them."""

from typing import ClassVar, Protocol

import viser

from tcfit_app.review.gestures.actions import Gestures
from tcfit_app.review.panels.compare_panel import ComparePanel
from tcfit_app.review.panels.export_panel import ExportPanel
from tcfit_app.review.panels.fit.fit_panel import FitPanel
from tcfit_app.review.panels.keypoints_panel import KeypointsPanel
from tcfit_app.review.panels.review_panel import ReviewPanel
from tcfit_app.review.panels.runs.runs_panel import RunsPanel
from tcfit_app.review.panels.start_panel import StartPanel
from tcfit_app.review.panels.view_panel import ViewPanel


class Panel(Protocol):
    """A tab beside the picture.

    Its callbacks say what the user wants by `Tab.do`; nothing is computed or drawn in them.
    """

    title: ClassVar[str]
    icon: ClassVar[viser.IconName]

    def __init__(self, gestures: Gestures) -> None:
        """Make its elements, in the tab that is open."""

    def draw(self) -> None:
        """Bring its elements to the tab's state. Called often: only what changed may be sent."""


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
