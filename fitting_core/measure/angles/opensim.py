"""A motion as coordinates of OpenSim's full-body model, which follow its own axes and not those of the ISB.

The model is that of Rajagopal et al., IEEE Trans. Biomed. Eng. 63 (2016) 2068, as `Rajagopal2015.osim` has it: names,
signs, order and axes of the coordinates. Its hips, back, pelvis and shoulders turn about z, x and y in this order. Its
ankles, subtalar joints, toes, elbows and forearms are hinges with oblique axes: their coordinates are those by which
the model's bones come nearest to the fit's. A hinge cannot follow in all directions, and the model's knee turns and
tilts by itself as it bends. Its bodies have the axes of `segments`, but for its arms (`ARM_FRAMES`).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from fitting_core.body.geometry import axis_angle
from fitting_core.body.markers.joint_centres import joint_centres_in_space
from fitting_core.measure.angles.cardan import angles_of, continuous, held, nearest_turn, unit_axis
from fitting_core.measure.angles.joint_angles import Segments
from fitting_core.measure.limbs import HIPS
from fitting_core.motion import Motion

_Axis = tuple[float, float, float]
_ANKLE: _Axis = (-0.10501355, -0.17402245, 0.97912632)
_SUBTALAR: _Axis = (0.78717961, 0.60474746, -0.12094949)
_TOES: _Axis = (0.58095440, 0.0, -0.81393611)
_ELBOW: _Axis = (0.22604696, 0.02226900, 0.97386183)
_FOREARM: _Axis = (0.05639803, 0.99840646, 0.00195200)
"""Unit axes of the model's hinges on the right side, in the frame of the parent."""
ARM_FRAMES = axis_angle(np.arctan2(_ELBOW[0], _ELBOW[2]) * np.array([0.0, -1.0, 0.0]))
"""Axes of the model's humerus, radius and hand in the anatomical frames of these segments: they are turned about their
length by 13 degrees, so that its elbow's axis and the line between its styloids are those of the ISB."""
_HIPS_FROM_PELVIS = np.array([-0.056276, -0.07849, 0.0])
"""Between the model's hip joints, metres from the origin of its pelvis, in the pelvis' frame."""
LOCKED = ("subtalar_angle", "mtp_angle", "wrist_flex", "wrist_dev")
"""Coordinates that the model holds still until they are unlocked, without their side."""
_STEPS = 200


@dataclass(frozen=True)
class OpenSimWorld:
    """OpenSim's world: x forward, y up, z to the right."""

    from_y_up: Float[np.ndarray, "3 3"]
    """By rows: its axes in the world y-up, whose z is towards the camera unless the camera's place is calibrated."""
    forward: str
    """Where x points in the world y-up, in words."""


_DIRECTIONS = (
    ("along z", (0.0, 0.0, 1.0)),
    ("along x", (1.0, 0.0, 0.0)),
    ("against z", (0.0, 0.0, -1.0)),
    ("against x", (-1.0, 0.0, 0.0)),
)


def opensim_world(segments: Segments) -> OpenSimWorld:
    """The world whose x is, of the four horizontal axes of y-up, the one that the pelvis mostly faces.

    The model's pelvis tilts first and turns last: only for who looks along x is its tilt what one calls so. By
    quarters, for so points of other files in y-up come into this world by swapping axes.

    Args:
        segments: Of a motion in y-up.
    """
    facing = segments.axes["pelvis"][:, :, 0].sum(0)
    forward, x = max(_DIRECTIONS, key=lambda direction: float(facing @ direction[1]))
    y = unit_axis("Y")
    return OpenSimWorld(from_y_up=np.stack([np.array(x), y, np.cross(x, y)]), forward=forward)


def opensim_coordinates(motion: Motion) -> tuple[dict[str, Float[np.ndarray, "T"]], OpenSimWorld]:
    """Coordinates by their names, in the model's order: degrees, and metres for pelvis_tx, _ty and _tz."""
    motion = motion.in_axes("y-up")
    segments = Segments(motion)
    world = opensim_world(segments)
    pelvis = world.from_y_up @ segments.axes["pelvis"]
    hips = joint_centres_in_space(motion.body, motion.params)[:, HIPS].mean(1) @ world.from_y_up.T
    places = hips - pelvis @ _HIPS_FROM_PELVIS
    tilt, obliquity, rotation = held(pelvis, "ZXY").T
    found = {"pelvis_tilt": tilt, "pelvis_list": obliquity, "pelvis_rotation": rotation}
    found |= {f"pelvis_t{axis}": values for axis, values in zip("xyz", places.T, strict=True)}
    for side, ending in (("right", "r"), ("left", "l")):
        for name, values in _leg(segments, side).items():
            found[f"{name}_{ending}"] = values
            if name == "knee_angle":
                found[f"knee_angle_{ending}_beta"] = values  # the kneecap's, which the model couples to it
    extension, bending, turn = held(segments.between("pelvis", "thorax"), "ZXY").T
    found |= {"lumbar_extension": extension, "lumbar_bending": bending, "lumbar_rotation": turn}
    for side, ending in (("right", "r"), ("left", "l")):
        found |= {f"{name}_{ending}": values for name, values in _arm(segments, side).items()}
    return found, world


def _leg(segments: Segments, side: str) -> dict[str, Float[np.ndarray, "T"]]:
    flexion, adduction, rotation = held(segments.between("pelvis", f"{side}_thigh"), "ZXY").T
    knee = -held(segments.between(f"{side}_thigh", f"{side}_shank"), "ZXY")[:, 0]
    ankle, subtalar = nearest_turns(segments.between(f"{side}_shank", f"{side}_foot"), _ANKLE, _SUBTALAR)
    toes = nearest_turn(segments.between(f"{side}_foot", f"{side}_toes"), np.array(_TOES))
    return {
        "hip_flexion": flexion,
        "hip_adduction": adduction,
        "hip_rotation": rotation,
        "knee_angle": knee,
        "ankle_angle": ankle,
        "subtalar_angle": subtalar,
        "mtp_angle": np.degrees(toes),
    }


def _arm(segments: Segments, side: str) -> dict[str, Float[np.ndarray, "T"]]:
    """The model's wrist does not turn about the forearm: this turn of the fit's wrist counts as pronation."""
    thorax, humerus, forearm, hand = "thorax", f"{side}_humerus", f"{side}_forearm", f"{side}_hand"
    flex, add, turn = held(segments.between(thorax, humerus) @ ARM_FRAMES, "ZXY").T
    wrist = ARM_FRAMES.T @ segments.between(forearm, hand) @ ARM_FRAMES
    twist, wrist_flex, wrist_dev = held(wrist, "YZX").T
    turned = axis_angle(np.radians(twist)[:, None] * unit_axis("Y"))
    forearm = ARM_FRAMES.T @ segments.between(humerus, forearm) @ ARM_FRAMES @ turned
    elbow, pronation = nearest_turns(forearm, _ELBOW, _FOREARM, start=(60.0, 60.0))
    return {
        "arm_flex": flex,
        "arm_add": add,
        "arm_rot": turn,
        "elbow_flex": elbow,
        "pro_sup": pronation,
        "wrist_flex": wrist_flex,
        "wrist_dev": wrist_dev,
    }


def nearest_turns(
    matrices: Float[np.ndarray, "T 3 3"], first: _Axis, second: _Axis, *, start: tuple[float, float] = (0.0, 0.0)
) -> Float[np.ndarray, "2 T"]:
    """Degrees about two unit axes, one after the other, by which a rotation comes nearest to these (trace distance).

    Each is improved in turn, from the Cardan angles about z and y, until none changes any more.

    Args:
        matrices: The rotations.
        first: The parent's axis.
        second: The child's.
        start: What the first frame is near to, of all full turns.
    """
    one, other = np.array(first), np.array(second)
    turns = np.radians(angles_of(matrices, "ZXY"))[:, [0, 2]] * (1.0, float(abs(second[1]) > abs(second[0])))
    for _ in range(_STEPS):
        before = turns
        along = nearest_turn(matrices @ axis_angle(-turns[:, 1:] * other), one)
        turns = np.stack([along, nearest_turn(axis_angle(-along[:, None] * one) @ matrices, other)], -1)
        if np.allclose(turns, before, atol=1e-9):
            break
    return continuous(np.degrees(turns), "ZY", start=start).T
