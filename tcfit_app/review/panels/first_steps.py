"""Above the panels: what someone who opens the app for the first time does, until they have read it."""

from tcfit_app.review.browser.page_states import StepsRead
from tcfit_app.review.gestures.actions import ACTIONS, Gestures
from tcfit_app.review.panels.elements.html import Board, Html, button, heading, joined, row, tag, text


class FirstSteps:
    """The list of one tab. Created before the panels, which stand below it."""

    def __init__(self, gestures: Gestures) -> None:
        self._tab, self._board = gestures.tab, Board(gestures.tab)

    def show(self, on: bool) -> None:
        """Draw it, if its time has come and this person's page is drawn."""
        session = self._tab.session
        if not on or not self._tab.state.steps or not session.project.has_detections:
            return self._board.show()
        fitted = session.fits.showable() or session.jobs
        steps = (
            _step("Play the clip", "play"),
            _step("Go to the next suspicious place", "next_suspect") if fitted else _step("Fit the body", "fit"),
            _step("Drag a wrong keypoint: the fit follows. To revert it", "undo"),
            _step("Export the result", "panel_export"),
        )
        read = row(button("Got it", "steps.read", do=self._close))
        self._board.show(heading("First steps", first=True), tag("ol", joined(*steps)), read)

    def _close(self) -> None:
        self._tab.set(steps=False)
        self._tab.channel.ask(StepsRead())


def _step(words: str, name: str) -> Html:
    """A step, and the key of the action that does it."""
    return tag("li", joined(text(f"{words} "), tag("kbd", next(map(str, ACTIONS[name].keys), ""))))
