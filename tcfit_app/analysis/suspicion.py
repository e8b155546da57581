"""The review queue: which frames of a fit to look at first, and why."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass

from tcfit_app.analysis.findings import FINDINGS, WHOLE, Finding
from tcfit_app.analysis.posed_fit import PosedFit
from tcfit_app.project.storage.clip_review import Worst
from tcfit_app.project.storage.marks import Mark

_GAP = 2
"""Maximum distance in frames between findings about the same limb that are one entry."""
_CAUSES = ("failed", "swap")
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
    """One of FINDINGS."""
    reason: str
    """A sentence about the worst frame: "left wrist is 42 px from its keypoint"."""
    joints: tuple[int, ...]
    """Keypoints concerned, worst first; empty if it is the pose as a whole."""
    about: tuple[str, ...]
    """The limbs concerned in any of its frames, and WHOLE if it is the whole body."""
    also: tuple[str, ...]
    """Other findings about the same in that frame."""

    @property
    def key(self) -> str:
        """Unique in its queue."""
        return f"{self.frame} {self.kind} {'+'.join(self.about)}"


@dataclass(frozen=True, kw_only=True)
class ReviewQueue:
    """What is left to review, and how much has been reviewed."""

    left: tuple[Suspect, ...]
    """Worst first."""
    looked_at: int
    """Number of entries whose frames were all marked as fine."""


Found = tuple[str, Finding]
"""A finding with its kind."""


@dataclass(kw_only=True)
class _Topic:
    """What is found about the same limbs in one frame, the cause or worst first."""

    frame: int
    about: frozenset[str]
    found: list[Found]

    @property
    def score(self) -> float:
        return max(finding.score for _, finding in self.found)

    @property
    def lasting(self) -> frozenset[tuple[range, str]]:
        """What lasts, of which each frame has the same finding."""
        return frozenset((one.lasting, one.reason) for _, one in self.found if one.lasting is not None)


def findings(fit: PosedFit) -> tuple[Found, ...]:
    """All findings in a whole clip."""
    return tuple((kind, one) for kind, found_in in FINDINGS.items() for one in found_in(fit))


def review_queue(
    found: Sequence[Found], *, checked: Collection[int] = (), limbs: Mapping[str, Collection[int]] | None = None
) -> ReviewQueue:
    """All suspicious frames of a whole clip, except for those marked as fine (see `still_checked`).

    Args:
        found: The clip's `findings`.
        checked: Frames marked as fine altogether.
        limbs: By limb, or WHOLE, the frames in which that was marked as fine.
    """
    fine = {limb: frozenset(frames) for limb, frames in (limbs or {}).items()}

    def left(one: Found) -> bool:
        _, finding = one
        return finding.frame not in checked and any(finding.frame not in fine.get(limb, ()) for limb in finding.about)

    entries = [_entry(span) for span in _spans(_topics(filter(left, found)))]
    reviewed = (not any(left(one) for topic in span for one in topic.found) for span in _spans(_topics(found)))
    return ReviewQueue(left=tuple(sorted(entries, key=_worst_first)), looked_at=sum(reviewed))


def _worst_first(suspect: Suspect) -> tuple[float, int]:
    return -suspect.score, suspect.frame


def worst_place(run: int, left: Sequence[Suspect], off: Mapping[str, float] | None = None) -> Worst:
    """What a project keeps of a run's queue, the worst first; `off` as of `Worst`."""
    off = dict(off or {})
    if not left:
        return Worst(run=run, left=0, off=off)
    first = left[0]
    score = round(first.score, 2)
    return Worst(run=run, left=len(left), score=score, frame=first.frame, words=first.reason, off=off)


def still_checked(
    marks: Mapping[int, Mark],
    edited: Mapping[int, Iterable[int]],
    *,
    refitted: Iterable[tuple[int, Iterable[int]]] = (),
) -> frozenset[int]:
    """Frames marked as fine that have not changed since; by order of storage, because clocks can be set back.

    Args:
        marks: Of frames, or of one limb in frames.
        edited: Which frames each log entry changes, `Project.frames_changed_after`.
        refitted: `Run.moment` of fits, and which frames they fitted.
    """
    checked = {frame: mark for frame, mark in marks.items() if mark.state == "checked"}
    edits, fits = {frame: m.last_edit for frame, m in checked.items()}, {f: m.last_moment for f, m in checked.items()}
    return frozenset(checked) - _later(edited.items(), edits) - _later(refitted, fits)


def _later(changes: Iterable[tuple[int, Iterable[int]]], known: Mapping[int, int]) -> frozenset[int]:
    """Frames with a change numbered higher than the known one."""
    return frozenset(f for number, frames in changes for f in frames if f in known and number > known[f])


def _topics(found: Iterable[Found]) -> list[_Topic]:
    """The findings by what they are about, in order of frames."""
    topics: dict[int, list[_Topic]] = {}
    for kind, finding in sorted(found, key=_first):
        there = topics.setdefault(finding.frame, [])
        known = next((topic for topic in there if topic.about >= finding.about or WHOLE in topic.about), None)
        if known is not None:
            known.found.append((kind, finding))
        else:
            there.append(_Topic(frame=finding.frame, about=finding.about, found=[(kind, finding)]))
    return [topic for frame in sorted(topics) for topic in topics[frame]]


def _first(one: Found) -> tuple[bool, float]:
    kind, finding = one
    return kind not in _CAUSES, -finding.score


def _spans(topics: Iterable[_Topic]) -> list[list[_Topic]]:
    """Group topics of neighbouring frames whose limbs are equal or a subset. Topics with one lasting finding form one
    group, also if some frames have further findings."""
    spans: list[list[_Topic]] = []
    lasting: dict[tuple[range, str], list[_Topic]] = {}
    for topic in topics:
        near = (span for span in reversed(spans) if 0 < topic.frame - span[-1].frame <= _GAP)
        alike = (span for span in near if topic.about <= span[-1].about or topic.about >= span[-1].about)
        span = next((lasting[each] for each in topic.lasting if each in lasting), None) or next(alike, None)
        if span is None:
            spans.append(span := [])
        span.append(topic)
        lasting |= dict.fromkeys(topic.lasting, span)
    return spans


def _entry(span: Sequence[_Topic]) -> Suspect:
    worst = max(span, key=lambda topic: topic.score)
    (kind, first), *others = worst.found
    about = frozenset[str]().union(*(finding.about for topic in span for _, finding in topic.found))
    return Suspect(
        frame=worst.frame,
        frames=range(span[0].frame, span[-1].frame + 1),
        score=worst.score,
        kind=kind,
        reason=first.reason,
        joints=first.joints,
        about=tuple(sorted(about)),
        also=tuple(dict.fromkeys(other.reason for _, other in others)),
    )
