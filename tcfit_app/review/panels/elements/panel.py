"""What every panel is."""

from typing import ClassVar, Protocol

import viser

from tcfit_app.review.gestures.gestures import Gestures


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
