"""The state of the selected keypoints in the chosen frames, in words."""

from collections.abc import Mapping

import numpy as np

from fitting_core.keypoints import LOCKABLE
from tcfit_app.project.edits.corrected import Corrected
from tcfit_app.review.gestures.edit_words import depth_words
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
        return _of_one(tab, state, frames[0], joints[0])
    noun = "frames" if len(joints) == 1 else "keypoints"
    if len(found) == 1:
        return f"{'Both' if total == 2 else f'All {total:,}'} {noun} {next(iter(found))}."
    return f"{', '.join(f'{count} {state}' for state, count in found.items())}, of {total:,} {noun}."


def _of_one(tab: Tab, state: str, frame: int, joint: int) -> str:
    corrected = tab.session.project.corrected
    parts = [f"{state.capitalize()}."]
    if state != "marked bad" and np.isfinite(depth := corrected.depth[frame, joint]):
        parts.append(f"{depth_words(*[round(100 * depth)] * 2).capitalize()}.")
    if corrected[frame].locked[joint] or corrected[[frame]].keypoints().overruled[0, joint]:
        parts.append("Rotation locked." if joint in LOCKABLE else "In a given hand shape.")
    if any(one.keypoint == joint and frame in one.frames for one in tab.session.project.kept):
        parts.append("It has a kept offset.")
    return " ".join(parts)
