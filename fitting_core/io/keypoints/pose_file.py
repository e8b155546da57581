"""`.pose` files as keypoints: OpenPose, MediaPipe Holistic and COCO-WholeBody points are read, OpenPose's written."""

from pathlib import Path

import numpy as np

from fitting_core.errors import InputError
from fitting_core.io.keypoints.coco_wholebody_layout import with_means
from fitting_core.io.keypoints.detections import Detections
from fitting_core.io.keypoints.json_points import MIN_CONFIDENCE, checked_points, stray_confidences
from fitting_core.io.keypoints.pose_binary import PoseFile, read_pose_file, write_pose_file
from fitting_core.io.keypoints.pose_components import BODIES, COMPONENTS, WITH_MEANS, openpose_components
from fitting_core.keypoints import COUNT, INDEX, NAMES, Keypoints

_LISTED = 6
"""Missing keypoints that a note names."""
_MOST_PEOPLE = 2_000_000
"""Over all frames: what takes 6 GB as 137 points."""


def read_pose(path: Path) -> Detections:
    """Read the keypoints of a `.pose` file, with its frame rate and image size.

    Points are found by the names of components and points, so that reduced files (fewer points of the face) read as
    well. MediaPipe's face mesh gives its nearest points, and the tip of its foot the big toe. Depths are not used.

    Raises:
        InputError: It is damaged, of another version, holds none of the known components, or values that cannot be.
    """
    pose = read_pose_file(path)
    places = _places(path, pose)
    shape = pose.data.shape[:2]
    if shape[0] * shape[1] > _MOST_PEOPLE:
        raise InputError(f"{path}: has {shape[1]} people in {shape[0]} frames; expected a few people in one clip.")
    points = np.zeros((*shape, COUNT, 3))
    found = np.concatenate([pose.data[..., :2], pose.confidence[..., None]], -1)
    # What was not detected may hold anything, NaN included.
    found[(pose.confidence <= 0) & (pose.confidence >= MIN_CONFIDENCE)] = 0
    used = [k for k, place in enumerate(places) if place is not None]
    ours = [place for place in places if place is not None]
    names = [NAMES[place] for place in ours]
    for t, person in np.ndindex(shape):
        where = f"{path}: frame {t}, person {person}"
        points[t, person, ours] = checked_points(where, found[t, person, used], names)
    if any(component.name in WITH_MEANS for component in pose.components):
        points = with_means(points)
    return Detections(
        frames=tuple(points),
        stems=tuple(f"{path.stem}_{t:012d}" for t in range(len(points))),
        source=path,
        scale="auto",
        size=pose.size if min(pose.size) > 0 else None,
        frame_rate=pose.frame_rate or None,
        notes=(*_notes(path, pose, set(ours)), *stray_confidences(path, pose.confidence[..., used].ravel())),
    )


def write_pose(
    path: Path, keypoints: Keypoints, *, size: tuple[int, int], frame_rate: float, first_frame: int = 0
) -> None:
    """Write one person's keypoints as the four components that pose-format has for OpenPose.

    Numbers are float32: positions to 0.0005 px in images of 8192 pixels. Reading gives all 137 back.

    Args:
        path: An existing file is replaced at once.
        keypoints: Pixels and confidences.
        size: Image width and height in pixels.
        frame_rate: Frames per second.
        first_frame: Frames to leave empty before the first one, as the format counts them from the video's first.

    Raises:
        InputError: The image is larger than the format can say.
    """
    components, places = openpose_components()
    detected = (keypoints.confidence > 0)[..., None]
    frames = np.concatenate([keypoints.xy, keypoints.confidence[..., None]], -1) * detected
    points = np.concatenate([np.zeros((first_frame, COUNT, 3)), frames])[:, None, places]
    pose = PoseFile(
        components=components, size=size, frame_rate=frame_rate, data=points[..., :2], confidence=points[..., 2]
    )
    write_pose_file(path, pose)


def _places(path: Path, pose: PoseFile) -> list[int | None]:
    """Of every point of the file, its place among the 137; None for points that have none."""
    places: list[int | None] = []
    for component in pose.components:
        known = COMPONENTS.get(component.name, {})
        places += [known.get(name) for name in component.points]
    used = [place for place in places if place is not None]
    if not used:
        found = ", ".join(f"{c.name} of {len(c.points)} points" for c in pose.components[:5])
        raise InputError(
            f"{path}: has the components {found}; expected those of OpenPose (pose_keypoints_2d, ...), MediaPipe "
            "Holistic (POSE_LANDMARKS, ...) or COCO-WholeBody (BODY, ...)."
        )
    if len(set(used)) < len(used):
        twice = next(place for place in used if used.count(place) > 1)
        raise InputError(
            f"{path}: has the point {NAMES[twice]} in two components; expected the points of one detector."
        )
    return places


def _notes(path: Path, pose: PoseFile, ours: set[int]) -> tuple[str, ...]:
    whose = next((BODIES[c.name] for c in pose.components if c.name in BODIES), "no body")
    made = {INDEX["neck"], INDEX["mid_hip"]} if whose != "OpenPose" else set()
    missing = [NAMES[place] for place in range(COUNT) if place not in ours | made]
    if not missing:
        return ()
    more = f" and {len(missing) - _LISTED} more" if len(missing) > _LISTED else ""
    listed = ", ".join(missing[:_LISTED]) + more
    return (f"{path.name} has the points of {whose}; it lacks {len(missing)} of our {COUNT}: {listed}.",)
