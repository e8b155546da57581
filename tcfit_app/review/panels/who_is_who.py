"""Frames in which the person on show may be someone else: a part of the Review panel."""

from fitting_core.io.people_file import Span
from tcfit_app.review.gestures.actions import Gestures
from tcfit_app.review.panels.elements.html import Board, Html, button, heading, paragraph, row
from tcfit_app.review.session.group import Doubt
from tcfit_app.review.tab.people import Someone

_MOST = 12
"""Spans listed; settled ones make room."""
_RIGHT = "Confirm that it is the same person before and after these frames"
_EXCHANGE = "Swaps the keypoints of both people from the frame on show to the end. Undo reverts both"


class WhoIsWho:
    """Lists the uncertain frames, with what can be done; empty if there is only one person."""

    def __init__(self, gestures: Gestures) -> None:
        self._gestures, self._tab = gestures, gestures.tab
        self._board = Board(gestures.tab)
        tab = gestures.tab
        tab.buttons.on("people.go", gestures.exchanging.go, self._doubt)
        tab.buttons.on("people.right", gestures.exchanging.confirm, self._doubt)
        tab.buttons.on(
            "people.exchange", self._exchange, {f"{one.number}": one for one in tab.someone.others}.__getitem__
        )

    def _doubt(self, value: str) -> Doubt:
        return {f"{i}": doubt for i, doubt in enumerate(self._gestures.exchanging.doubts)}[value]

    def _exchange(self, other: Someone) -> None:
        tab = self._tab
        tab.pause()
        self._gestures.exchanging.exchange(other, tab.state.frame + tab.first_frame)

    def draw(self) -> None:
        """Send what changed."""
        tab, spans = self._tab, self._tab.someone.uncertain
        number = None if tab.state.playing else tab.state.frame + tab.first_frame
        if tab.someone.others:
            self._board.show(*self._rows(spans, number))

    def _rows(self, spans: tuple[Span, ...], number: int | None) -> list[Html]:
        someone, fixed = self._tab.someone, self._tab.session.project.read_only
        rows = [heading("Who is who", f"{len(spans)} not sure" if spans else "")]
        if spans:
            rows.append(paragraph(f"Is this {someone.name} before and after these frames?", "dim"))
        for i, (first, last) in enumerate(spans[:_MOST]):
            where = f"Frame {first}" if first == last else f"Frames {first}–{last}"
            there = number is not None and first <= number <= last
            rows.append(
                row(
                    button(where, "people.go", f"{i}", pressed=there, hint="Go there, and select them"),
                    button("Same person", "people.right", f"{i}", disabled=fixed, hint=_RIGHT),
                )
            )
        rows += [paragraph(half, "warn") for half in self._gestures.exchanging.halves]
        label = "From here on" if number is None else f"From {number} on"
        exchanges = (
            button(f"Exchange with {one.name}", "people.exchange", f"{one.number}", disabled=fixed, hint=_EXCHANGE)
            for one in someone.others
        )
        rows.append(row(*exchanges, label=label, wrap=len(someone.others) > 1))
        return rows
