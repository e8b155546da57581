"""Above the panels: which of the clip's people is shown, corrected and fitted."""

from typing import Any

from tcfit_app.review.panels.elements.field import Dropdown
from tcfit_app.review.tab.tab import Tab

_HINT = "The person to correct and fit; the others are dimmed. Q: next person"


class PersonChoice:
    """The dropdown of one tab while it shows one person; absent if there is only one."""

    def __init__(self, tab: Tab) -> None:
        self._tab = tab
        self._names = {someone.name: someone for someone in tab.someone.all_people}
        self._choice: Dropdown | None = None
        if len(self._names) > 1:
            here = tab.someone.name
            self._handle: Any = tab.client.gui.add_dropdown(
                "Person", tuple(self._names), initial_value=here, hint=_HINT
            )
            self._choice = Dropdown(tab, self._handle, lambda name: tab.go_to(self._names[name]), lambda: here)

    def show(self, on: bool) -> None:
        """Hide it while another person's page, which has its own, is drawn."""
        if self._choice is not None:
            self._handle.visible = on

    def draw(self) -> None:
        """Set it back to the person on show."""
        if self._choice is not None:
            self._choice.draw()
