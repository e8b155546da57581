"""Focal length and vertical of a still camera: what is likely of any camera, and the straight edges in its pictures."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from fitting_core.camera import Camera, FocalFrom, Vertical, focal_from_35mm
from fitting_core.errors import InputError
from fitting_core.ground.gravity import gravity_before_fit, rolled_views
from fitting_core.ground.lines import POSSIBLE_FOCALS, LineEvidence, edge_lengths, edges_of, line_evidence
from fitting_core.image_border import seen_confidence
from fitting_core.keypoints import Keypoints
from fitting_core.lens import straightened
from fitting_core.lifting.clip_lifting import lift
from fitting_core.video.frames import FrameSource

_USUAL_MM, _SPREAD = 32.0, 0.25
"""Prior over cameras: 35 mm equivalent, and standard deviation of its logarithm. Phones have 24 to 28 mm, and filming
crops a little; cameras are longer. The mean error over 16 real clips is 0.15."""
_LEAST_SPREAD = 0.06
"""Of an estimate's logarithm: 19 of 23 held-out photographs were nearer than this."""
_LEAST_DEVIATION, _MOST_DEVIATION = 1.0, 3.0
"""Degrees: of a vertical from edges at least, and above which it is not used."""
_PICTURES = 15
"""Frames whose median is taken: people who move vanish from it."""
_MOVED = 0.5
"""Length of the median picture's edges over that of single frames below which the camera moved."""
_ONE_IN_TEN = 1.2816
"""Standard deviations."""
_ROUNDS = 2
"""The vertical that the person tells, around which edges are searched, depends on the focal length."""


def camera_from_pictures(
    camera: Camera,
    keypoints: Keypoints,
    frame_rate: float,
    video: Path | None,
    frames: Sequence[int],
    *,
    estimate: bool,
) -> Camera:
    """The camera with the focal length and the vertical that its pictures tell.

    Args:
        camera: Of the clip. One that moves stays as it is, except for a focal length.
        keypoints: Of the whole clip, straightened.
        frame_rate: Frames per second.
        video: A video file or a folder of images; None if there is none.
        frames: Numbers of the clip's frames in it.
        estimate: Whether the focal length is estimated; otherwise the camera's own holds.
    """
    usual = focal_from_35mm(_USUAL_MM, camera.size)
    found = replace(camera, focal=(usual, usual)) if estimate else camera
    edges = None
    told = camera.world is not None and camera.world.up is not None
    if video is not None and camera.path is None and not (told and not estimate) and (keypoints.confidence > 0).any():
        edges = _still_edges(video, frames, camera)
    evidence = None
    for _ in range(_ROUNDS if estimate else 1):
        evidence = None if edges is None else _evidence(edges, found, keypoints, frame_rate, free=estimate)
        if evidence is None or not estimate:
            break
        found = _with_focal(found, evidence, usual)
    if estimate:
        found = _described(found if evidence is not None else replace(found, focal_deviation=_SPREAD))
    return found if evidence is None or told else _with_vertical(found, evidence)


def _evidence(
    edges: Float[np.ndarray, "n 4"], camera: Camera, keypoints: Keypoints, frame_rate: float, *, free: bool
) -> LineEvidence | None:
    """What the edges tell, around the vertical that the person tells."""
    confidence = seen_confidence(keypoints, camera)
    lifted = lift(keypoints.xy, confidence, camera, frame_rate, calibrated=camera.calibrated)
    rolled = rolled_views(keypoints.xy, confidence, camera, frame_rate)
    gravity = gravity_before_fit(lifted, confidence, camera, rolled)
    focals = POSSIBLE_FOCALS * max(camera.size) if free else np.array(camera.focal[:1])
    return line_evidence(edges, focals, camera.center, gravity)


def _with_focal(camera: Camera, evidence: LineEvidence, usual: float) -> Camera:
    """With the mean of the logarithm over the posterior, and its deviation."""
    log = np.log(evidence.focals)
    posterior = evidence.log_likelihood - 0.5 * ((log - np.log(usual)) / _SPREAD) ** 2
    share = np.exp(posterior - posterior.max())
    share /= share.sum()
    mean = float(share @ log)
    deviation = float(np.hypot(np.sqrt(share @ (log - mean) ** 2), _LEAST_SPREAD))
    focal = float(np.exp(mean))
    return replace(camera, focal=(focal, focal), focal_deviation=deviation, focal_from=FocalFrom.ESTIMATED)


def _described(camera: Camera) -> Camera:
    focal, deviation = camera.focal[0], camera.focal_deviation or _SPREAD
    low, high = (focal * np.exp(way * _ONE_IN_TEN * deviation) for way in (-1, 1))
    by_lines = deviation < 0.8 * _SPREAD
    what = (
        "estimated from straight lines in the video" if by_lines else f"assumed: {_USUAL_MM:g} mm, as usual of phones"
    )
    source = f"{what}, with 80 % confidence between {low:.0f} and {high:.0f} px"
    return replace(camera, focal_from=FocalFrom.ESTIMATED, source=source)


def _with_vertical(camera: Camera, evidence: LineEvidence) -> Camera:
    nearest = int(np.argmin(np.abs(np.log(evidence.focals / camera.focal[0]))))
    deviation = float(np.hypot(evidence.deviations[nearest], _LEAST_DEVIATION))
    if deviation > _MOST_DEVIATION:
        return camera
    x, y, z = evidence.ups[nearest].tolist()
    return replace(camera, vertical=Vertical(up=(x, y, z), deviation=deviation))


def _still_edges(video: Path, frames: Sequence[int], camera: Camera) -> Float[np.ndarray, "n 4"] | None:
    """Edges of what stands still in the straightened pictures; None if the camera moved, or the video is unreadable."""
    try:
        with FrameSource(video) as source:
            pictures = _grey(source, frames)
    except InputError:  # a keypoint file beside a broken video
        return None
    edges = edges_of(np.median(pictures, 0).astype(np.uint8))
    alone = np.median([_length(edges_of(picture)) for picture in pictures[:: max(1, len(pictures) // 3)]])
    if not len(edges) or _length(edges) < _MOVED * alone:
        return None
    if camera.lens is None:
        return edges
    straight, found = straightened(camera.lens, edges.reshape(-1, 2, 2))
    return straight.reshape(-1, 4)[found.all(1)]


def _grey(source: FrameSource, frames: Sequence[int]) -> list[UInt8[np.ndarray, "h w"]]:
    chosen = np.unique(np.linspace(0, len(frames) - 1, _PICTURES).round().astype(int))
    return [cv2.cvtColor(source.frame(frames[i]), cv2.COLOR_RGB2GRAY) for i in chosen]


def _length(edges: Float[np.ndarray, "n 4"]) -> float:
    return float(edge_lengths(edges).sum())
