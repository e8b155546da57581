"""The panels beside the picture: one file each, and the table of them."""

from typing import ClassVar, Protocol

import viser

from tcfit_app.review.gestures.actions import ACTIONS, Gestures, panel_actions
from tcfit_app.review.panels.correct.correct_panel import CorrectPanel
from tcfit_app.review.panels.export_panel import ExportPanel
from tcfit_app.review.panels.fit.fit_panel import FitPanel
from tcfit_app.review.panels.review_panel import ReviewPanel


class Panel(Protocol):
    """A tab beside the picture.

    Its callbacks only issue commands through `Tab.do`; they compute and draw nothing.
    """

    title: ClassVar[str]
    icon: ClassVar[viser.IconName]

    def __init__(self, gestures: Gestures) -> None:
        """Create its elements in the current tab."""

    def draw(self) -> None:
        """Update its elements from the tab's state. Called often: send only what changed."""


PANELS: list[type[Panel]] = []
"""In tab order."""


def add_panel(kind: type[Panel]) -> None:
    """Show a panel behind the others, with a key and a command."""
    PANELS.append(kind)
    ACTIONS.update(panel_actions([panel.title for panel in PANELS]))


for _kind in (CorrectPanel, ReviewPanel, FitPanel, ExportPanel):
    add_panel(_kind)
