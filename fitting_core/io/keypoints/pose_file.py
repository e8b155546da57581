"""`.pose` files as keypoints: reads points of OpenPose, MediaPipe Holistic and COCO-WholeBody, writes OpenPose's."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from fitting_core.detections import Detections
from fitting_core.errors import InputError
from fitting_core.io.keypoints.json_points import MIN_CONFIDENCE, checked_points, stray_confidences
from fitting_core.io.keypoints.pose_binary import Component, PoseFile, read_pose_file, write_pose_file
from fitting_core.keypoint_noise import COCO_WHOLEBODY, MEDIAPIPE, OPENPOSE
from fitting_core.keypoints import BODY_25, BONES, COUNT, FACE, GROUPS, INDEX, LEFT_HAND, NAMES, RIGHT_HAND, Keypoints
from fitting_core.wholebody import COCO_17, FACE_MESH, FEET_6, with_means

_SHORT = {"right_": "R", "left_": "L"}


def _camel(name: str) -> str:
    """OpenPose's spelling of a name: left_big_toe is LBigToe."""
    for side, letter in _SHORT.items():
        if name.startswith(side):
            return letter + _camel(name.removeprefix(side))
    return "".join(word.capitalize() for word in name.split("_"))


_MOST_EMPTY = 1_000_000
"""Frames: nine hours of video."""
_OPENPOSE_BODY = tuple(_camel(name) for name in BODY_25)
_OPENPOSE_HAND = (
    "BASE T_STT T_BCMC T_MCP T_IP I_CMC I_MCP I_PIP I_DIP M_CMC M_MCP M_PIP M_DIP R_CMC R_MCP R_PIP R_DIP "
    "P_CMC P_MCP P_PIP P_DIP"
).split()
"""pose-format's names of OpenPose's points; despite their names, the last of each finger is its tip."""
_OPENPOSE_FACE = (
    [f"FB_{i}" for i in range(17)]
    + [f"FEB_{i}" for i in range(17, 27)]
    + [f"FN_{i}" for i in range(27, 36)]
    + [f"FE_{i}" for i in range(36, 48)]
    + [f"FLO_{i}" for i in range(48, 60)]
    + [f"FLI_{i}" for i in range(60, 68)]
    + ["FP_68", "FP_69"]
)
_FINGERS = {"INDEX_FINGER": "index", "MIDDLE_FINGER": "middle", "RING_FINGER": "ring", "PINKY": "pinky"}
_MEDIAPIPE_HAND = [
    "WRIST",
    *(f"THUMB_{part}" for part in ("CMC", "MCP", "IP", "TIP")),
    *(f"{finger}_{part}" for finger in _FINGERS for part in ("MCP", "PIP", "DIP", "TIP")),
]
# fmt: off
_MEDIAPIPE_BODY = {
    "NOSE": "nose",
    **{f"{side}_{part}": f"{side}_{part}".lower()
       for side in ("LEFT", "RIGHT")
       for part in ("EYE", "EAR", "SHOULDER", "ELBOW", "WRIST", "HIP", "KNEE", "ANKLE", "HEEL")},
    "LEFT_FOOT_INDEX": "left_big_toe", "RIGHT_FOOT_INDEX": "right_big_toe",
}
"""The others (corners of eyes and mouth, fingers of the body model) have no equivalent among ours, or a better one."""
# fmt: on
_FACE_70 = range(FACE.start, FACE.stop)


def _hand(side: slice, names: Sequence[str]) -> dict[str, int]:
    return dict(zip(names, range(side.start, side.stop), strict=True))


_COCO_HAND = [f"hand_{i}" for i in range(21)]

COMPONENTS: dict[str, dict[str, int]] = {
    "pose_keypoints_2d": {name: i for i, name in enumerate(_OPENPOSE_BODY)},
    "face_keypoints_2d": dict(zip(_OPENPOSE_FACE, _FACE_70, strict=True)),
    "hand_left_keypoints_2d": _hand(LEFT_HAND, _OPENPOSE_HAND),
    "hand_right_keypoints_2d": _hand(RIGHT_HAND, _OPENPOSE_HAND),
    "POSE_LANDMARKS": {name: INDEX[ours] for name, ours in _MEDIAPIPE_BODY.items()},
    "FACE_LANDMARKS": {str(point): place for point, place in zip(FACE_MESH, _FACE_70, strict=True)},
    "LEFT_HAND_LANDMARKS": _hand(LEFT_HAND, _MEDIAPIPE_HAND),
    "RIGHT_HAND_LANDMARKS": _hand(RIGHT_HAND, _MEDIAPIPE_HAND),
    "BODY": {name: INDEX[name] for name in (*COCO_17, *FEET_6)},
    "FACE": {f"face-{i}": FACE.start + i for i in range(68)},
    "LEFT_HAND": _hand(LEFT_HAND, _COCO_HAND),
    "RIGHT_HAND": _hand(RIGHT_HAND, _COCO_HAND),
}
"""By component name: our index for each of its points, by the point's name."""
BODIES = {
    "pose_keypoints_2d": (OPENPOSE, "OpenPose"),
    "POSE_LANDMARKS": (MEDIAPIPE, "MediaPipe Holistic"),
    "BODY": (COCO_WHOLEBODY, "COCO-WholeBody"),
}
"""By the body's component: whose points the file has, and their name in notes."""
WITH_MEANS = ("POSE_LANDMARKS", "BODY")
"""Bodies without neck and mid-hip, which are computed from shoulders and hips."""

_WRITTEN = {
    "pose_keypoints_2d": ("body", (255, 0, 0)),
    "face_keypoints_2d": ("face", (128, 0, 0)),
    "hand_left_keypoints_2d": ("left_hand", (0, 128, 0)),
    "hand_right_keypoints_2d": ("right_hand", (0, 0, 192)),
}


def openpose_components() -> tuple[tuple[Component, ...], tuple[int, ...]]:
    """pose-format's four components for OpenPose, with our index for each of their points, in order."""
    components, places = [], []
    for name, (group, color) in _WRITTEN.items():
        part, points = GROUPS[group], COMPONENTS[name]
        inside = range(part.start, part.stop)
        assert list(points.values()) == list(inside)
        limbs = tuple((a - part.start, b - part.start) for a, b in BONES if a in inside and b in inside)
        components.append(Component(name=name, points=tuple(points), limbs=limbs, colors=(color,)))
        places += inside
    return tuple(components), tuple(places)


_LISTED = 6
"""Most missing keypoints that a note names."""
_MOST_PEOPLE = 2_000_000
"""Over all frames: takes 6 GB as 137 points."""


def read_pose(path: Path) -> Detections:
    """Read the keypoints of a `.pose` file, with its frame rate and image size.

    Points are found by component and point name, so reduced files (fewer face points) are read too. MediaPipe's face
    points are the nearest in its mesh, and its foot tip becomes the big toe. Depths are not used.

    Raises:
        InputError: It is damaged, of another version, holds no known component, or invalid values.
    """
    pose = read_pose_file(path)
    places = _places(path, pose)
    shape = pose.data.shape[:2]
    if shape[0] * shape[1] > _MOST_PEOPLE:
        raise InputError(f"{path}: has {shape[1]} people in {shape[0]} frames; expected a few people in one clip.")
    points = np.zeros((*shape, COUNT, 3))
    found = np.concatenate([pose.data[..., :2], pose.confidence[..., None]], -1)
    # Undetected points may hold anything, NaN included.
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
        detector=_body(pose)[0],
        notes=(*_notes(path, pose, set(ours)), *stray_confidences(path, pose.confidence[..., used].ravel())),
    )


def write_pose(
    path: Path, keypoints: Keypoints, *, size: tuple[int, int], frame_rate: float, first_frame: int = 0
) -> None:
    """Write one person's keypoints as pose-format's four components for OpenPose. Raises InputError if the image is too
    large for the format.

    Numbers are float32: positions to 0.0005 px in images of 8192 pixels. Reading gives all 137 back.

    Args:
        path: An existing file is replaced atomically.
        keypoints: Pixels and confidences.
        size: Image width and height in pixels.
        frame_rate: Frames per second.
        first_frame: Empty frames to write before the first one, as the format counts from the video's first. None are
            written for a number above 1,000,000, which is a date in an image's name and not a count.
    """
    components, places = openpose_components()
    detected = (keypoints.confidence > 0)[..., None]
    frames = np.concatenate([keypoints.xy, keypoints.confidence[..., None]], -1) * detected
    before = np.zeros((first_frame if first_frame <= _MOST_EMPTY else 0, COUNT, 3))
    points = np.concatenate([before, frames])[:, None, places]
    pose = PoseFile(
        components=components, size=size, frame_rate=frame_rate, data=points[..., :2], confidence=points[..., 2]
    )
    write_pose_file(path, pose)


def _places(path: Path, pose: PoseFile) -> list[int | None]:
    """The index among the 137 of every point of the file; None for points without one."""
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


def _body(pose: PoseFile) -> tuple[str, str]:
    return next((BODIES[c.name] for c in pose.components if c.name in BODIES), ("", "no body"))


def _notes(path: Path, pose: PoseFile, ours: set[int]) -> tuple[str, ...]:
    detector, whose = _body(pose)
    made = {INDEX["neck"], INDEX["mid_hip"]} if detector != OPENPOSE else set()
    missing = [NAMES[place] for place in range(COUNT) if place not in ours | made]
    if not missing:
        return ()
    more = f" and {len(missing) - _LISTED} more" if len(missing) > _LISTED else ""
    listed = ", ".join(missing[:_LISTED]) + more
    return (f"{path.name} has the points of {whose}; it lacks {len(missing)} of our {COUNT}: {listed}.",)
