"""The table of the selected keypoints."""

from collections import Counter

from tcfit_app.analysis.body_regions import full_name
from tcfit_app.project.edits.corrected import Corrected
from tcfit_app.review.panels.elements.html import Html, heading, joined, line, paragraph, table, tag
from tcfit_app.review.tab.tab import Tab

_MOST = 5
"""Keypoints that are listed one by one."""
_STATES = ("bad", "corrected", "detected", "missing")
"""The style sheet knows these names."""


def state_of(corrected: Corrected, frame: int, joint: int) -> str:
    """What a keypoint is, one of _STATES."""
    if corrected.bad[frame, joint]:
        return "bad"
    if corrected.confidence[frame, joint] == 0:
        return "missing"
    return "corrected" if corrected.edited[frame, joint] else "detected"


def selection_table(tab: Tab) -> list[Html]:
    """The selected keypoints in the frame on show as HTML, the one selected last at first."""
    chosen, frame = tab.state.selection[::-1], tab.state.frame
    title = f"{len(chosen) or 'No'} keypoint{'s' if len(chosen) != 1 else ''} selected"
    if not chosen:
        return [
            heading(title, first=True),
            paragraph("Click one in the picture, or draw a rectangle with Shift held.", "dim"),
        ]
    head = ("keypoint", "state", "conf.", "x, y in pixels")
    rows = [_line(tab, joint) for joint in chosen[:_MOST]]
    parts = [heading(title, f"frame {frame + tab.first_frame}", first=True), table(rows, head, numbers=(2, 3))]
    if len(chosen) > _MOST:
        counts = Counter(state_of(tab.session.project.corrected, frame, joint) for joint in chosen)
        of_all = ", ".join(f"{counts[state]} {state}" for state in _STATES if counts[state])
        parts.append(paragraph(f"and {len(chosen) - _MOST} more: of all, {of_all}", "dim"))
    return parts


def _line(tab: Tab, joint: int) -> Html:
    frame, corrected = tab.state.frame, tab.session.project.corrected
    name, state = full_name(joint), state_of(corrected, frame, joint)
    shown = tag("span", state, class_=f"tcfit-{state}")
    if state == "missing":
        return line(name, shown, "–", "–", numbers=(2, 3), whole=(1,))
    confidence = f"{corrected.confidence[frame, joint]:.2f}"
    return line(name, shown, confidence, _place(tab, joint), numbers=(2, 3), whole=(1,))


def _place(tab: Tab, joint: int) -> Html:
    """Where a keypoint is, and where it was detected if that is somewhere else."""
    frame, detections = tab.state.frame, tab.session.project.detections
    x, y = tab.session.project.corrected.xy[frame, joint]
    u, v = detections.xy[frame, joint]
    here = tag("span", f"{x:.1f}, {y:.1f}")
    if not detections.confidence[frame, joint] > 0 or (x, y) == (u, v):
        return here
    hint = f"Moved by {x - u:+.1f}, {y - v:+.1f} pixels from where it was detected"
    return joined(here, tag("div", f"was {u:.1f}, {v:.1f}", class_="tcfit-dim", title=hint))
