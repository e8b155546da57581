"""Focal length and vertical of a still camera: what is likely of any camera, and the straight edges in its pictures."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, UInt8

from fitting_core.camera import Camera, FocalFrom, Vertical, focal_from_35mm
from fitting_core.errors import InputError
from fitting_core.ground.gravity import gravity_before_fit, rolled_views, told_gravity
from fitting_core.ground.lines import (
    POSSIBLE_FOCALS,
    LineEvidence,
    along_three,
    bend_of,
    edges_of,
    line_evidence,
    share_seen,
    unbent,
)
from fitting_core.image_border import seen_confidence
from fitting_core.keypoints import Keypoints
from fitting_core.lifting.clip_lifting import lift
from fitting_core.video.sampled import SampledPictures

_USUAL_MM, _SPREAD = 32.0, 0.25
"""Prior over cameras: 35 mm equivalent, and standard deviation of its logarithm. Phones have 24 to 28 mm, and filming
crops a little; cameras are longer. The mean error over 16 real clips is 0.15."""
_LEAST_SPREAD, _LEAST_MOVING = 0.06, 0.1
"""Of an estimate's logarithm: 19 of 23 held-out photographs were nearer than this. Pictures of a camera that moves are
blurred and skewed, and no such clip with a known lens was at hand."""
_FEW = 0.2
"""Standard deviation above which the user reads that the edges are few."""
_LEAST_DEVIATION, _MOST_DEVIATION = 1.0, 3.0
"""Degrees: of a vertical from edges at least, and above which it is not used."""
_STILL = 0.3
"""Share of the median picture's edges that each frame has in the same place, unless the camera moved: at least 0.86 on
room clips, 0.43 on signers who fill the picture."""
_BENT, _SURELY = 0.02, 3.0
"""Bend of a lens, and its standard deviations, above which it counts: below, it changes no focal length by more than
their least spread."""
_ONE_IN_TEN = 1.2816
"""Standard deviations."""
_ROUNDS = 2
"""The vertical that the person tells, around which edges are searched, depends on the focal length."""


@dataclass(frozen=True, kw_only=True, eq=False)
class StraightLines:
    """The straight edges that a camera is estimated from."""

    edges: Float[np.ndarray, "n 4"]
    """From x, y to x, y in pixels of the straightened picture."""
    along: Bool[np.ndarray, "n"]
    """Which of them run along the vertical or one of two level directions at right angles; none without a vertical."""


def straight_lines(camera: Camera, video: Path, frames: Sequence[int]) -> StraightLines:
    """The straight edges in a clip's pictures, for users to look at; none if the camera moves.

    Args:
        camera: Of the clip.
        video: A video file or a folder of images.
        frames: Numbers of the clip's frames in it.
    """
    sampled = SampledPictures(video, frames, camera)
    pictures, still = _pictures(sampled)
    if camera.path is not None or not still:
        return StraightLines(edges=np.zeros((0, 4)), along=np.zeros(0, bool))
    edges, straight = _edges(pictures[0], sampled.scale, camera)
    gravity = told_gravity(camera)
    along = np.zeros(len(edges), bool)
    if gravity is not None:
        along = along_three(straight, camera.focal[0], camera.center, gravity.up)
    return StraightLines(edges=edges, along=along)


def camera_from_pictures(
    camera: Camera,
    keypoints: Keypoints,
    frame_rate: float,
    pictures: SampledPictures | None,
    *,
    estimate: bool,
) -> Camera:
    """The camera with the focal length and the vertical that its pictures tell.

    Args:
        camera: Of the clip. With a path, it stays as it is but for a usual focal length. Pictures that move without one
            give a focal length and no vertical.
        keypoints: Of the whole clip, straightened.
        frame_rate: Frames per second.
        pictures: Of the clip, if it has any.
        estimate: Whether the focal length is estimated; otherwise the camera's own holds.
    """
    up_known = camera.world is not None and camera.world.up is not None
    edges, still = list[Float[np.ndarray, "n 4"]](), True
    if pictures and camera.path is None and (estimate or not up_known) and (keypoints.confidence > 0).any():
        shown, still = _pictures(pictures)
        edges = [_edges(picture, pictures.scale, camera)[1] for picture in shown if estimate or still]
    usual = _estimated(camera, float(np.log(focal_from_35mm(_USUAL_MM, camera.size))), _SPREAD) if estimate else camera
    found = usual
    for _ in range(_ROUNDS if estimate else 1):
        evidence = _evidence(edges, found, keypoints, frame_rate, free=estimate)
        if evidence is None:
            return usual
        share = _posterior(evidence, usual)
        if estimate:
            log = np.log(evidence.focals)
            mean = float(share @ log)
            least = _LEAST_SPREAD if still else _LEAST_MOVING
            found = _estimated(camera, mean, float(np.hypot(np.sqrt(share @ (log - mean) ** 2), least)))
    return found if up_known or not still else _with_vertical(found, evidence, share)


def _evidence(
    edges: Sequence[Float[np.ndarray, "n 4"]], camera: Camera, keypoints: Keypoints, frame_rate: float, *, free: bool
) -> LineEvidence | None:
    """Evidence of the edges of one picture or several, near the vertical estimated from the person; None without."""
    if not edges:
        return None
    confidence = seen_confidence(keypoints, camera)
    lifted = lift(keypoints.xy, confidence, camera, frame_rate, calibrated=camera.calibrated)
    rolled = rolled_views(keypoints.xy, confidence, camera, frame_rate)
    gravity = gravity_before_fit(lifted, confidence, camera, rolled)
    focals = POSSIBLE_FOCALS * max(camera.size) if free else np.array(camera.focal[:1])
    found = [line_evidence(own, focals, camera.center, gravity) for own in edges]
    usable = [one for one in found if one is not None and len(one.focals) == len(focals)]
    if not usable:
        return found[0]
    # Pictures of one place are not independent: their mean, not their sum.
    return replace(usable[0], log_likelihood=np.mean([one.log_likelihood for one in usable], axis=0))


def _posterior(evidence: LineEvidence, usual: Camera) -> Float[np.ndarray, "F"]:
    """Probabilities of the evidence's focal lengths: the edges' likelihood times the prior."""
    prior = -0.5 * (np.log(evidence.focals / usual.focal[0]) / _SPREAD) ** 2
    share = np.exp(evidence.log_likelihood + prior - (evidence.log_likelihood + prior).max())
    return share / share.sum()


def _estimated(camera: Camera, log_focal: float, deviation: float) -> Camera:
    """With an estimated focal length, from its logarithm and the standard deviation of that."""
    focal, low, high = (float(np.exp(log_focal + way * _ONE_IN_TEN * deviation)) for way in (0, -1, 1))
    what = "estimated from straight lines in the picture"
    if deviation == _SPREAD:
        what = f"35 mm equivalent of {_USUAL_MM:g} mm, typical of phones and cameras"
    elif deviation > _FEW:
        what = "estimated from few straight lines in the picture"
    source = f"{what}, with 80 % confidence between {low:.0f} and {high:.0f} px"
    by = FocalFrom.ESTIMATED
    return replace(camera, focal=(focal, focal), focal_deviation=deviation, focal_from=by, source=source)


def _with_vertical(camera: Camera, evidence: LineEvidence, share: Float[np.ndarray, "F"]) -> Camera:
    """With the vertical of the nearest of the evidence's focal lengths, if the others hardly move it."""
    up = evidence.ups[np.abs(np.log(evidence.focals / camera.focal[0])).argmin()]
    off = np.degrees(np.arccos(np.clip(evidence.ups @ up, -1, 1)))
    deviation = float(np.sqrt(share @ (evidence.deviations**2 + off**2) + _LEAST_DEVIATION**2))
    if deviation > _MOST_DEVIATION:
        return camera
    x, y, z = up.tolist()
    return replace(camera, vertical=Vertical(up=(x, y, z), deviation=deviation))


def _pictures(sampled: SampledPictures) -> tuple[UInt8[np.ndarray, "n h w"], bool]:
    """The median of the straightened pictures, and True; if the camera moved, a few of them, and False.

    None of them if the video is unreadable.
    """
    try:
        pictures = sampled.stacked()
    except InputError:  # a keypoint file beside a broken video
        return np.zeros((0, 1, 1), np.uint8), False
    count = len(pictures)
    median = np.partition(pictures, count // 2, 0)[count // 2]
    edges = edges_of(median)
    if min(share_seen(median, edges, picture) for picture in pictures) >= _STILL:
        return median[None], True
    return pictures[[count // 6, count // 2, 5 * count // 6]], False


def _edges(
    picture: UInt8[np.ndarray, "h w"], scale: float, camera: Camera
) -> tuple[Float[np.ndarray, "n 4"], Float[np.ndarray, "n 4"]]:
    """Edges of a straightened picture, in pixels of the frame, and as they are without what bend is left in it."""
    x, y = camera.center
    found = edges_of(picture)
    bend, deviation = bend_of(picture, found, (x * scale, y * scale))
    edges = found / scale
    if abs(bend) < max(_BENT, _SURELY * deviation):
        return edges, edges
    return edges, unbent(edges, bend, camera.center, camera.size)
