"""How panels say which frames their buttons change."""

from tcfit_app.project.frame_words import in_words
from tcfit_app.review.panels.elements.html import Html, button, paragraph, row
from tcfit_app.review.tab.tab import Tab


def unseen(tab: Tab) -> list[Html]:
    """What to do while the frame on show is not among the selected ones: then nothing is changed."""
    if not tab.hidden_frames_chosen:
        return []
    here, chosen = tab.state.frame + tab.first_frame, in_words(tab.chosen_frames, tab.first_frame)
    return [
        paragraph(f"Frame {here} is not among the selected {chosen}.", "warn"),
        row(button("Go there", "frames.go", do=lambda: _go(tab))),
    ]


def _go(tab: Tab) -> None:
    tab.pause()
    tab.seek(tab.chosen_frames[0])
