"""What every panel is."""

from typing import TYPE_CHECKING, ClassVar, Protocol

import viser

if TYPE_CHECKING:
    from tcfit_app.review.page import Page


class Panel(Protocol):
    """A tab beside the picture.

    Its callbacks say what the user wants by `page.do`; nothing is computed or drawn in them.
    """

    title: ClassVar[str]
    icon: ClassVar[viser.IconName]

    def __init__(self, page: "Page") -> None:
        """Make its elements, in the tab that is open."""

    def draw(self) -> None:
        """Bring its elements to the page's state. Called often: only what changed may be sent."""
