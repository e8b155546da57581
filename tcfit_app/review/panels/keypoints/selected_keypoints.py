"""The table of the selected keypoints."""

from dataclasses import dataclass

from tcfit_app.analysis.body_regions import full_name
from tcfit_app.project.edits.corrected import Corrected
from tcfit_app.review.panels.elements.html import Html, heading, joined, line, paragraph, table, tag
from tcfit_app.review.tab.tab import Tab

_MOST = 5
"""Keypoints that are listed one by one."""
_STATES = {"bad": "bad", "corrected": "corrected", "detected": "detected", "missing": "missing"}
"""In words; the names are those of the style sheet."""


@dataclass(frozen=True, kw_only=True)
class Selected:
    """One keypoint in one frame."""

    name: str
    state: str
    """One of _STATES."""
    confidence: float
    xy: tuple[float, float]
    detected: tuple[float, float] | None
    """Where the detector saw it, if it did."""


def state_of(corrected: Corrected, frame: int, joint: int) -> str:
    """What a keypoint is: "bad", "corrected", "detected" or "missing"."""
    if corrected.bad[frame, joint]:
        return "bad"
    if corrected.confidence[frame, joint] == 0:
        return "missing"
    return "corrected" if corrected.edited[frame, joint] else "detected"


def selected_keypoints(tab: Tab) -> list[Selected]:
    """What is selected, in the frame on show, the one selected last at first."""
    frame, project = tab.state.frame, tab.session.project
    corrected, detections = project.corrected, project.detections
    found = []
    for joint in reversed(tab.state.selection):
        x, y = corrected.xy[frame, joint].tolist()
        u, v = detections.xy[frame, joint].tolist()
        seen = detections.confidence[frame, joint] > 0
        found.append(
            Selected(
                name=full_name(joint),
                state=state_of(corrected, frame, joint),
                confidence=float(corrected.confidence[frame, joint]),
                xy=(x, y),
                detected=(u, v) if seen else None,
            )
        )
    return found


def selection_table(chosen: list[Selected], frame: int) -> list[Html]:
    """The selected keypoints as HTML.

    Args:
        chosen: as from `selected_keypoints`.
        frame: the number that users see for the frame.
    """
    title = f"{len(chosen) or 'No'} keypoint{'s' if len(chosen) != 1 else ''} selected"
    if not chosen:
        return [
            heading(title, first=True),
            paragraph("Click one in the picture, or draw a rectangle with Shift held.", "dim"),
        ]
    head = ("keypoint", "state", "conf.", "x, y in pixels")
    rows = [row for one in chosen[:_MOST] for row in _lines(one)]
    parts = [heading(title, f"frame {frame}", first=True), table(rows, head, numbers=(2, 3))]
    if len(chosen) > _MOST:
        parts.append(paragraph(f"and {len(chosen) - _MOST} more: {_counts(chosen)}", "dim"))
    return parts


def _lines(one: Selected) -> list[Html]:
    state = tag("span", _STATES[one.state], class_=f"tcfit-{one.state}")
    there = one.state != "missing"
    confidence = f"{one.confidence:.2f}" if there else "–"
    where = _position(one.xy) if there else "–"
    place = text_of_detection(one)
    shown = joined(tag("span", where), place) if place else where
    return [line(one.name, state, confidence, shown, numbers=(2, 3), whole=(1,))]


def text_of_detection(one: Selected) -> Html | None:
    """Where a keypoint was detected, if that is somewhere else."""
    if one.detected is None or one.state == "missing" or one.detected == one.xy:
        return None
    dx, dy = one.xy[0] - one.detected[0], one.xy[1] - one.detected[1]
    return tag(
        "div",
        f"was {_position(one.detected)}",
        class_="tcfit-dim",
        title=f"Moved by {dx:+.1f}, {dy:+.1f} pixels from where it was detected",
    )


def _position(xy: tuple[float, float]) -> str:
    return f"{xy[0]:.1f}, {xy[1]:.1f}"


def _counts(chosen: list[Selected]) -> str:
    by_state = {state: sum(one.state == state for one in chosen) for state in _STATES}
    return "of all, " + ", ".join(f"{count} {_STATES[state]}" for state, count in by_state.items() if count)
