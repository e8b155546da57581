"""A fit's hands as tiers of annotations: visibility; movement, hold and rest; and handshape."""

from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Bool

from fitting_core.io.eaf import Annotation, Tier, milliseconds_of
from fitting_core.keypoints import LEFT_HAND, RIGHT_HAND, SIDES, Side
from fitting_core.measure.hands.handshapes import FARTHEST, HandshapeSet, Nearest, finger_bones
from fitting_core.measure.hands.phases import HOLD, MOVEMENT, REST, Span, hand_phases, spans_of, without_short
from tcfit_app.analysis.posed_fit import PosedFit

_HANDS = {"left": LEFT_HAND, "right": RIGHT_HAND}
VISIBLE = "visible"
UNCLEAR = "unclear"
"""A handshape close to none of the set."""
_CONFIDENT = 0.3
"""Minimum confidence, as for keypoints counted in the reprojection error."""
_SHARE = 0.5
"""Minimum fraction of a hand's keypoints detected where it is visible."""
_FLICKER = 0.1
"""Seconds: shorter gaps and appearances are ignored, because detectors lose a hand in single frames."""
_END = 0.1
"""Seconds: the end of a movement, used for its shape if no hold follows."""
_PHASES = {
    MOVEMENT: "The wrist moves relative to the trunk",
    HOLD: "The wrist is still, above the hips",
    REST: "The wrist is still, near the hips, the lap or the thighs",
}


def names_of(side: Side) -> tuple[str, str, str, str]:
    """The tiers of a hand: visible, phase, handshape and its distance."""
    hand = side.capitalize()
    return f"{hand} hand visible", f"{hand} hand phase", f"{hand} handshape", f"{hand} handshape distance"


def hand_tiers(fit: PosedFit, shapes: HandshapeSet) -> list[Tier]:
    """The tiers of both hands over a whole clip; `shapes` are posed on the fit's body."""
    return [tier for side in SIDES for tier in _tiers(fit, shapes, side)]


def _tiers(fit: PosedFit, shapes: HandshapeSet, side: Side) -> Iterator[Tier]:
    visible, phase, handshape, distance = names_of(side)
    seen, rate = visible_frames(fit, side), fit.clip.frame_rate
    phases = hand_phases(fit.joints, side, rate)
    found = handshapes(fit, shapes, side, phases, seen)
    named = [Span(frames=frames, label=near.name if near.near else UNCLEAR) for frames, near in found]
    distances = [Span(frames=frames, label=_in_words(near)) for frames, near in found]
    meanings = {name: "" for name in shapes.names} | {UNCLEAR: f"More than {FARTHEST:g}° from every shape of the set"}
    yield Tier(
        name=visible,
        kind="hand visible",
        annotations=annotations(fit, spans_of([VISIBLE if s else "" for s in seen])),
        vocabulary={VISIBLE: "The hand's keypoints are detected"},
    )
    yield Tier(name=phase, kind="hand phase", annotations=annotations(fit, phases), vocabulary=_PHASES)
    yield Tier(name=handshape, kind="handshape", annotations=annotations(fit, named), vocabulary=meanings)
    yield Tier(name=distance, kind="handshape distance", annotations=annotations(fit, distances), parent=handshape)


def annotations(fit: PosedFit, spans: Sequence[Span]) -> tuple[Annotation, ...]:
    """Spans of a fit's frames with their time in the video."""
    first, found = fit.clip.first_frame, []
    for span in spans:
        frames = range(first + span.frames.start, first + span.frames.stop)
        start, end = milliseconds_of(frames, fit.clip.frame_rate)
        found.append(Annotation(start=start, end=end, text=span.label))
    return tuple(found)


def visible_frames(fit: PosedFit, side: Side) -> Bool[np.ndarray, "T"]:
    """Where at least half of a hand's keypoints are detected, without flicker."""
    shortest = max(1, round(_FLICKER * fit.clip.frame_rate))
    seen = (fit.clip.keypoints.confidence[:, _HANDS[side]] > _CONFIDENT).mean(1) >= _SHARE
    return without_short(~without_short(~seen, shortest), shortest)


def handshapes(
    fit: PosedFit, shapes: HandshapeSet, side: Side, phases: Sequence[Span], seen: Bool[np.ndarray, "T"]
) -> list[tuple[range, Nearest]]:
    """The shape of a hand in each hold, and at the end of each movement that no hold follows.

    Only frames in which the hand is visible count, and there is no shape if it is visible in fewer than half of them:
    the fit then says what is likely, not what was there.
    """
    bones, found = finger_bones(fit.points, side), []
    for frames in _told(phases, max(1, round(_END * fit.clip.frame_rate))):
        here = seen[frames.start : frames.stop]
        if here.mean() < _SHARE:
            continue
        nearest = shapes.nearest(bones[frames.start : frames.stop][here])
        if nearest is not None:
            found.append((frames, nearest))
    return found


def _told(phases: Sequence[Span], end: int) -> Iterator[range]:
    for span, following in zip(phases, [*phases[1:], None], strict=True):
        if span.label == HOLD:
            yield span.frames
        elif span.label == MOVEMENT and (following is None or following.label != HOLD):
            yield span.frames[-end:]


def _in_words(nearest: Nearest) -> str:
    """The distance in words; if no shape is near, also the nearest one."""
    return f"{nearest.degrees:.0f}°" if nearest.near else f"{nearest.degrees:.0f}° from {nearest.name}"
