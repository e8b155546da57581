"""A part of a panel that is folded until it is needed.

viser's folders cannot be opened by the server, as for a key that leads into one.
"""

from tcfit_app.review.panels.elements.html import Board, button, row
from tcfit_app.review.tab.tab import Tab


class Fold:
    """A button, and below it what is created in the context of this, while it is open.

    Args:
        tab: the panel's tab, which remembers the open folds in its state.
        name: identifies it among all folds.
    """

    def __init__(self, tab: Tab, name: str) -> None:
        self._tab, self._name = tab, name
        self._head = Board(tab)
        self._folder = tab.client.gui.add_folder(None, visible=False)

    def __enter__(self) -> None:
        self._folder.__enter__()

    def __exit__(self, *error: object) -> None:
        self._folder.__exit__(None, None, None)

    @property
    def open(self) -> bool:
        """Whether what is in it is on show, if the fold itself is."""
        return self._name in self._tab.state.folds

    def turn(self, *, on: bool) -> None:
        """Open or close it."""
        self._tab.set(folds=self._tab.state.folds - {self._name} | ({self._name} if on else set()))

    def draw(self, title: str, *, on: bool = True) -> bool:
        """Update the button.

        Args:
            title: its label, with a count if it is a list.
            on: whether the fold is on show.

        Returns:
            Whether its content is on show, and has to be drawn.
        """
        shown = on and self.open
        sign = "▾" if shown else "▸"
        head = button(
            f"{sign} {title}", "fold", self._name, do=lambda: self.turn(on=not shown), expanded=shown, kind="fold"
        )
        self._head.show(*([row(head)] if on else []))
        if self._folder.visible is not shown:
            self._folder.visible = shown
        return shown
