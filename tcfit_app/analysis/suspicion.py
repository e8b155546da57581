"""The review queue: which frames of a fit to look at first, and why."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass

from tcfit_app.analysis.body_regions import LIMB_OF
from tcfit_app.analysis.findings import FINDINGS, Finding, added_findings
from tcfit_app.analysis.posed_fit import PosedFit
from tcfit_app.project.storage.clip_review import Worst
from tcfit_app.project.storage.marks import Mark

_GAP = 2
"""Maximum distance in frames between findings about the same limb that are one entry."""
_CAUSES = ("swap",)
"""Kinds that explain others: swapped arms are far off and jump too."""


@dataclass(frozen=True, kw_only=True)
class Suspect:
    """A queue entry: one frame, or several with the same problem."""

    frame: int
    """The worst of its frames."""
    frames: range
    """From the first to the last of its frames."""
    score: float
    """Highest score in the worst frame; comparable between kinds, from 1."""
    kind: str
    """One of FINDINGS, or a plugin's."""
    reason: str
    """A few words about the worst frame: "left wrist is 42 px off"."""
    joints: tuple[int, ...]
    """Keypoints concerned, worst first; empty if it is the pose as a whole."""
    also: tuple[str, ...]
    """Other findings in that frame."""


@dataclass(frozen=True, kw_only=True)
class ReviewQueue:
    """What is left to review, and how much has been reviewed."""

    left: tuple[Suspect, ...]
    """Worst first."""
    looked_at: int
    """Number of entries whose frames were all marked as fine."""


_Found = tuple[str, Finding]
"""A finding with its kind."""


def review_queue(fit: PosedFit, *, checked: Collection[int] = ()) -> ReviewQueue:
    """All suspicious frames of a whole clip, except for those marked as fine (see `still_checked`)."""
    by_frame: dict[int, list[_Found]] = {}
    for kind, found_in in (FINDINGS | added_findings()).items():
        for finding in found_in(fit):
            by_frame.setdefault(finding.frame, []).append((kind, finding))
    for found in by_frame.values():
        found.sort(key=lambda f: (f[0] not in _CAUSES, -f[1].score))
    left = {frame: found for frame, found in by_frame.items() if frame not in checked}
    entries = [_entry(span, left) for span in _spans(left)]
    return ReviewQueue(
        left=tuple(sorted(entries, key=lambda suspect: (-suspect.score, suspect.frame))),
        looked_at=sum(left.keys().isdisjoint(span) for span in _spans(by_frame)),
    )


def worst_place(run: int, left: Sequence[Suspect]) -> Worst:
    """What a project keeps of a run's queue, the worst first."""
    if not left:
        return Worst(run=run, left=0)
    first = left[0]
    return Worst(run=run, left=len(left), score=round(first.score, 2), frame=first.frame, words=first.reason)


def still_checked(
    marks: Mapping[int, Mark],
    edited: Mapping[int, Iterable[int]],
    *,
    refitted: Iterable[tuple[int, Iterable[int]]] = (),
) -> frozenset[int]:
    """Frames marked as fine that have not changed since; by order of storage, because clocks can be set back.

    Args:
        edited: Which frames each log entry changes, `Project.frames_changed_after`.
        refitted: `Run.moment` of fits, and the frames they fitted.
        refitted: `Run.moment` of fits, and which frames they fitted.
    """
    checked = {frame: mark for frame, mark in marks.items() if mark.state == "checked"}
    edits, fits = {frame: m.last_edit for frame, m in checked.items()}, {f: m.last_moment for f, m in checked.items()}
    return frozenset(checked) - _later(edited.items(), edits) - _later(refitted, fits)


def _later(changes: Iterable[tuple[int, Iterable[int]]], known: Mapping[int, int]) -> frozenset[int]:
    """Frames with a change numbered higher than the known one."""
    return frozenset(f for number, frames in changes for f in frames if f in known and number > known[f])


def _spans(by_frame: dict[int, list[_Found]]) -> list[list[int]]:
    spans: list[list[int]] = []
    for frame in sorted(by_frame):
        near = spans and frame - spans[-1][-1] <= _GAP
        if near and _same_limb(by_frame[frame][0][1], by_frame[spans[-1][-1]][0][1]):
            spans[-1].append(frame)
        else:
            spans.append([frame])
    return spans


def _same_limb(one: Finding, other: Finding) -> bool:
    """Whether two findings may have one cause; one about the whole pose may share its cause with any."""
    limbs, others = ({LIMB_OF[joint] for joint in finding.joints} for finding in (one, other))
    return not limbs or not others or bool(limbs & others)


def _score(found: list[_Found]) -> float:
    return max(finding.score for _, finding in found)


def _entry(span: list[int], by_frame: dict[int, list[_Found]]) -> Suspect:
    worst = max(span, key=lambda frame: _score(by_frame[frame]))
    (kind, first), *others = by_frame[worst]
    return Suspect(
        frame=worst,
        frames=range(span[0], span[-1] + 1),
        score=_score(by_frame[worst]),
        kind=kind,
        reason=first.reason,
        joints=first.joints,
        also=tuple(dict.fromkeys(other.reason for _, other in others)),
    )
