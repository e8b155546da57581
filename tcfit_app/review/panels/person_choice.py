"""Above the panels: which of a clip's people is shown, corrected and fitted."""

from typing import Any

from tcfit_app.review.panels.elements.field import Dropdown
from tcfit_app.review.tab.tab import Tab

_HINT = "Which of the clip's people is corrected and fitted; the others are drawn dimmed. Key Q: the next"


class PersonChoice:
    """The drop-down of one tab, for as long as that shows one person; nothing where there is but one."""

    def __init__(self, tab: Tab) -> None:
        self._tab = tab
        self._names = {someone.name: someone for someone in tab.someone.everybody}
        self._choice: Dropdown | None = None
        if len(self._names) > 1:
            here = tab.someone.name
            self._handle: Any = tab.client.gui.add_dropdown(
                "Person", tuple(self._names), initial_value=here, hint=_HINT
            )
            self._choice = Dropdown(tab, self._handle, lambda name: tab.browser.go_to(self._names[name]))

    def show(self, on: bool) -> None:
        """While another person's page is drawn, that has one of its own."""
        if self._choice is not None:
            self._handle.visible = on

    def draw(self) -> None:
        """Bring it back to the person on show."""
        if self._choice is not None:
            self._choice.show(self._tab.someone.name)
