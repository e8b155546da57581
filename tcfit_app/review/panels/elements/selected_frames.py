"""How panels say which frames their buttons change."""

from tcfit_app.project.frame_words import in_words
from tcfit_app.review.panels.elements.html import Html, button, paragraph, row
from tcfit_app.review.tab.tab import Tab


def named(label: str, tab: Tab) -> str:
    """A button's label, with the selected frames if any: "Mark bad, frames 3–7"."""
    return label if tab.state.frames is None else f"{label}, {in_words(tab.state.frames, tab.first_frame)}"


def unseen(tab: Tab) -> list[Html]:
    """A warning while the frame on show is not among the selected ones: then nothing is changed."""
    if not tab.hidden_frames_chosen:
        return []
    chosen = in_words(tab.chosen_frames, tab.first_frame)
    return [
        paragraph(f"Selected: {chosen}, which excludes the frame on show, so nothing is changed.", "warn"),
        row(
            button("Go to them", "frames.go", do=lambda: _go(tab)),
            button("Clear frame selection", "frames.none", do=lambda: tab.set(frames=None)),
        ),
    ]


def _go(tab: Tab) -> None:
    tab.pause()
    tab.seek(tab.chosen_frames[0])
