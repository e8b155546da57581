"""The selected keypoints in words: their state in the chosen frames, and their figures in the frame on show."""

from collections.abc import Mapping

import numpy as np

from fitting_core.errors import InputError
from fitting_core.keypoints import LOCKABLE
from tcfit_app.project.edits.corrected import Corrected
from tcfit_app.project.edits.edit_log import Redo, Remark, Undo
from tcfit_app.review.gestures.edit_words import depth_words, whose
from tcfit_app.review.panels.elements.html import Html, paragraph
from tcfit_app.review.tab.tab import Tab

_STATES = ("detected", "corrected", "pinned in space", "not detected", "marked bad")


def states(tab: Tab) -> Mapping[str, int]:
    """How many of the selected keypoints in the chosen frames are in each state that any of them has."""
    project, joints, frames = tab.session.project, tab.state.selection, tab.chosen_frames
    corrected = project.corrected
    if (view := tab.corrected_view) is not None:
        frames, corrected = tab.frames_in(view), view.corrected
    key = joints, frames, view, project.keypoints_version
    return tab.once("states", key, lambda: _counted(corrected[np.ix_(frames, joints)]))


def _counted(corrected: Corrected) -> Mapping[str, int]:
    """Keypoints by their state, of which the last that applies counts."""
    state = np.zeros(corrected.bad.shape, int)
    for i, holds in enumerate((corrected.edited, corrected.pinned, corrected.confidence == 0, corrected.bad), 1):
        state[holds] = i
    counts = np.bincount(state.ravel(), minlength=len(_STATES)).tolist()
    return {name: count for name, count in zip(_STATES, counts, strict=True) if count}


def sentence(tab: Tab) -> str:
    """The state of what is selected."""
    found, frames, joints, view = states(tab), tab.chosen_frames, tab.state.selection, tab.corrected_view
    if view is not None and not (frames := tab.frames_in(view)):
        return "It was not filmed at this moment."
    total = len(frames) * len(joints)
    if total == 1 and view is not None:
        return f"{next(iter(found)).capitalize()}."
    if total == 1:
        (state,) = found
        shown = tab.shown.body("b")
        key = frames, joints, tab.session.project.keypoints_version, None if shown is None else shown.version
        return tab.once("sentence", key, lambda: _of_one(tab, state, frames[0], joints[0]))
    noun = "frames" if len(joints) == 1 else "keypoints"
    if len(found) == 1:
        return f"{'Both' if total == 2 else f'All {total:,}'} {noun} {next(iter(found))}."
    return f"{', '.join(f'{count} {state}' for state, count in found.items())}, of {total:,} {noun}."


def _of_one(tab: Tab, state: str, frame: int, joint: int) -> str:
    corrected = tab.session.project.corrected
    by = _author(tab, frame, joint) if state in _STATES[1:3] or state == "marked bad" else ""
    parts = [f"{state.capitalize()}{by}."]
    if state != "marked bad" and np.isfinite(depth := corrected.depth[frame, joint]):
        parts.append(f"{depth_words(*[round(100 * depth)] * 2).capitalize()}.")
    if corrected[frame].locked[joint] or corrected[[frame]].keypoints().overruled[0, joint]:
        parts.append("Rotation locked." if joint in LOCKABLE else "In a given hand shape.")
    if any(one.keypoint == joint and frame in one.frames for one in tab.session.project.kept):
        parts.append("Its depth has a kept offset.")
    if state not in ("marked bad", "not detected") and (gap := _gap(tab, frame, joint)) is not None:
        parts.append(f"The fit is {gap:.0f} px away.")
    return " ".join(parts)


def _author(tab: Tab, frame: int, joint: int) -> str:
    """Who made the last correction of a keypoint that stands."""
    project = tab.session.project
    for entry in reversed(project.log):
        said = entry.action
        if isinstance(said, Undo | Redo | Remark) or frame not in said.frames or joint not in said.joints:
            continue
        if project.standing.stood(entry.id):
            by = whose(entry.author, tab.author)
            return f" in {by}" if by == "another browser" else f" by {by}"
    return ""


def _gap(tab: Tab, frame: int, joint: int) -> float | None:
    """Pixels between the keypoint and the fit on show; None if that is unknown."""
    body = tab.shown.body("b")
    if body is None or body.frame != frame or body.live is not None or tab.data.warming:
        return None
    try:
        (gap,) = tab.data.gaps(body, (joint,))
    except InputError:  # the body is missing, which the status line says
        return None
    return gap if np.isfinite(gap) else None


def figures(tab: Tab) -> list[Html]:
    """Confidence and position of one keypoint in the frame on show, or the confidence of several; none if missing."""
    project, frame, joints = tab.session.project, tab.state.frame, tab.state.selection
    if tab.corrected_view is not None:
        return []
    corrected, detected = project.corrected[frame], project.detected
    there = [joint for joint in joints if corrected.present[joint]]
    if not there:
        return []
    where = f"Frame {frame + tab.first_frame} · " if len(tab.chosen_frames) > 1 else ""
    low, high = (f"{bound(corrected.confidence[there]):.2f}" for bound in (np.min, np.max))
    if len(joints) > 1:
        return [paragraph(f"{where}Confidence {low if low == high else f'{low} to {high}'}", "dim")]
    (x, y), (u, v) = corrected.xy[there[0]], detected.xy[frame, there[0]]
    moved = detected.confidence[frame, there[0]] > 0 and (x, y) != (u, v)
    from_there = f", detected at {u:.1f}, {v:.1f} px" if moved else ""
    return [paragraph(f"{where}Confidence {low} · {x:.1f}, {y:.1f} px{from_there}", "dim")]
