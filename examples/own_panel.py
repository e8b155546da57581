"""Open a review with a panel of your own: python examples/own_panel.py walk.tcfit"""

import sys
from pathlib import Path
from typing import ClassVar

import numpy as np
import viser

from tcfit_app.cli.review_command import review
from tcfit_app.options.fit import ServerOptions
from tcfit_app.project.project import Project
from tcfit_app.review.gestures.actions import Gestures
from tcfit_app.review.panels import add_panel
from tcfit_app.review.panels.elements.html import Board, button, paragraph


class WayPanel:
    """The way of the body in fit B, and a button that goes to the frame where it moves most."""

    title: ClassVar[str] = "Way"
    icon: ClassVar[viser.IconName] = viser.Icon.RUN

    def __init__(self, gestures: Gestures) -> None:
        self._tab, self._board = gestures.tab, Board(gestures.tab)

    def draw(self) -> None:
        fit = self._tab.shown.b
        if fit is None:
            self._board.show(paragraph("There is no fit yet."))
            return
        steps = np.linalg.norm(np.diff(fit.params.camera_translation.numpy(), axis=0), axis=1)
        fastest = int(steps.argmax()) + 1
        text = f"{fit.title}: {steps.sum():.2f} m, fastest in frame {fastest}"
        self._board.show(paragraph(text), button("Go there", "way.fastest", do=lambda: self._tab.seek(fastest)))


def main(folder: str) -> None:
    add_panel(WayPanel)
    with Project.open(Path(folder)) as project:
        review(project, ServerOptions())


if __name__ == "__main__":
    main(*sys.argv[1:])
