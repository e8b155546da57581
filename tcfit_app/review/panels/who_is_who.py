"""Frames in which the person on show may be someone else: a part of the Review panel."""

from functools import partial

from tcfit_app.review.gestures.actions import Gestures
from tcfit_app.review.gestures.edit_words import capitalized
from tcfit_app.review.gestures.exchanging import span_in_words
from tcfit_app.review.panels.elements.fold import Fold
from tcfit_app.review.panels.elements.html import Board, Html, button, paragraph, row
from tcfit_app.review.tab.people import ReviewedPerson

_MOST = 12
"""Spans listed; settled ones make room."""
_RIGHT = "Confirm that it is the same person before and after these frames"
_EXCHANGE = "Swaps the keypoints of both people from the frame on show to the end. Undo reverts both"


class WhoIsWho:
    """Lists the uncertain frames, with what can be done; empty if there is only one person."""

    def __init__(self, gestures: Gestures) -> None:
        self._gestures, self._tab = gestures, gestures.tab
        self._fold = Fold(gestures.tab, "people")
        with self._fold:
            self._board = Board(gestures.tab)

    def _exchange(self, other: ReviewedPerson) -> None:
        tab = self._tab
        tab.pause()
        self._gestures.exchanging.exchange(other, tab.state.frame + tab.first_frame)

    def draw(self) -> None:
        """Send what changed."""
        tab = self._tab
        number = None if tab.state.playing else tab.state.frame + tab.first_frame
        doubts = len(self._gestures.exchanging.doubts)
        title = f"Who is who ({doubts} uncertain)" if doubts else "Who is who"
        if self._fold.draw(title, on=bool(tab.someone.others)):
            self._board.show(*self._rows(number))

    def _rows(self, number: int | None) -> list[Html]:
        someone, fixed = self._tab.someone, self._tab.session.project.read_only
        exchanging = self._gestures.exchanging
        doubts = exchanging.doubts
        question = f"Is this {someone.name} before and after these frames?"
        rows = [paragraph(question, "dim")] if doubts else []
        for i, doubt in enumerate(doubts[:_MOST]):
            first, last = doubt.span
            there = number is not None and first <= number <= last
            rows.append(
                row(
                    button(
                        capitalized(span_in_words(doubt.span)),
                        "people.go",
                        f"{i}",
                        do=partial(exchanging.go, doubt),
                        pressed=there,
                        hint="Go there, and select them",
                    ),
                    button(
                        "Same person",
                        "people.right",
                        f"{i}",
                        do=partial(exchanging.confirm, doubt),
                        disabled=fixed,
                        hint=_RIGHT,
                    ),
                )
            )
        rows += [paragraph(half, "warn") for half in exchanging.halves]
        label = "From here on" if number is None else f"From {number} on"
        exchanges = (
            button(
                f"Exchange with {one.name}",
                "people.exchange",
                f"{one.number}",
                do=partial(self._exchange, one),
                disabled=fixed,
                hint=_EXCHANGE,
            )
            for one in someone.others
        )
        rows.append(row(*exchanges, label=label, wrap=len(someone.others) > 1))
        return rows
