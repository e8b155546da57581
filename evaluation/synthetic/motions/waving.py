"""The Simple Motion: a standing person raises one hand, waves, and lowers it.

World: x to the person's left, y up, z forward, metres, seconds; the origin lies on the floor between the feet.
"""

from dataclasses import dataclass

import numpy as np

from evaluation.synthetic.acting.script import (
    ArmKey,
    Build,
    Hazard,
    Script,
    Vector,
    hanging,
    mirrored,
    mirrored_hazards,
)


@dataclass(frozen=True, kw_only=True)
class Manner:
    """How one person waves."""

    mirror: bool
    """With the left hand."""
    rate: float
    """Waves in a second."""
    swing: float
    """Metres that the wrist moves to either side."""
    tilt: float
    """Degrees that the hand tilts to either side."""
    height: float
    """Of the wrist above the shoulders, metres, for arms of usual length."""
    out: float
    """Of the wrist from the middle, metres, for arms of usual length."""
    shape: str
    """Of the hand."""
    lean: float
    """Degrees that the trunk leans away from the hand."""

    @staticmethod
    def draw(rng: np.random.Generator) -> "Manner":
        """One person's by chance."""
        return Manner(
            mirror=bool(rng.random() < 0.35),
            rate=rng.uniform(1.5, 2.1),
            swing=rng.uniform(0.05, 0.09),
            tilt=rng.uniform(16, 26),
            height=rng.uniform(0.12, 0.26),
            out=rng.uniform(0.34, 0.42),
            shape=str(rng.choice(["flat", "spread", "spread"])),
            lean=rng.uniform(1, 4),
        )


def waving(build: Build, seconds: float, rng: np.random.Generator) -> tuple[Script, list[Hazard]]:
    """A person's way of waving, and where detectors fail on it.

    Args:
        build: Of the person.
        seconds: Of the whole.
        rng: Source of chance.
    """
    manner = Manner.draw(rng)
    start = min(0.15 + 0.1 * (seconds - 2.0), 0.4)
    up, down = start + 0.55, seconds - 0.75 - start / 2
    arm = [hanging(0.0, build), hanging(start, build), _rising(start + 0.32, build, manner)]
    arm += [*_waves(up, down, build, manner), _rising(down + 0.25, build, manner), hanging(down + 0.62, build)]
    lean = (0.0, 2.0, -manner.lean)
    # The hips never stand at the very height of straight legs: all of them a little lower.
    hips = [(0.0, (0, 0, 0)), (up, (0.02, -0.006, 0)), (down, (0.025, -0.007, 0)), (seconds, (0, 0, 0))]
    script = Script(
        seconds=seconds,
        arms={"right": arm, "left": [hanging(0.0, build)]},
        hips_path=[(time, np.add(value, (0, -0.006, 0))) for time, value in hips],
        hips_turn=[(0.0, (0, 0, 0)), (up, (0, 2, -1)), (down, (0, 2, -1)), (seconds, (0, 0, 0))],
        spine_turn=[(start, (0, 0, 0)), (up, lean), (down, lean), (down + 0.6, (1, 0, 0))],
        head_turn=[
            (0.0, (2, 0, 0)),
            (start + 0.1, (2, 0, 0)),
            (up, (-2, 4, 5)),
            (down, (-2, 4, 4)),
            (seconds, (1, 2, 0)),
        ],
        jaw_degrees=[(start, (0,)), (up, (4,)), (up + 0.4, (1,)), (down, (0,))],
        face={"smile": [(start, (0.1,)), (up, (1.0,)), (down, (0.9,)), (seconds, (0.4,))]},
    )
    hazards = [
        Hazard("dropped", start + 0.2, up + 0.3, ("right_hand",)),
        Hazard("dropped", up, down, ("right_hand",)),
        Hazard("dropped", down, down + 0.6, ("right_wrist", "right_hand")),
        Hazard("swapped", 0.0, start + 0.4, ("arms",), likely=0.3),
        Hazard("occluded", up, seconds, ("left_wrist", "left_elbow", "left_hand")),
        Hazard("swapped", up, seconds, ("legs",), likely=0.3),
    ]
    return (mirrored(script), mirrored_hazards(hazards)) if manner.mirror else (script, hazards)


def _rising(time: float, build: Build, manner: Manner) -> ArmKey:
    wrist = build.arm * np.array((manner.out, -0.16, 0.26))
    fingers, palm = (0.1, 0.35, 0.9), (-0.5, -0.75, 0.3)
    return ArmKey(time, _vector(wrist), fingers, palm, "relaxed", (0.75, -0.65, -0.3))


def _waves(up: float, down: float, build: Build, manner: Manner) -> list[ArmKey]:
    """Keys at the ends of the waves, between two times; the first and the last wave are smaller."""
    count = max(2, round(2 * manner.rate * (down - up)))
    keys = []
    for i, time in enumerate(np.linspace(up, down, count + 1).tolist()):
        side = (-1.0) ** i * (0.6 if i in (0, count) else 1.0)
        lower = 0.012 * (side * side)
        wrist = build.arm * np.array((manner.out + side * manner.swing, manner.height - lower, 0.20))
        angle = np.radians(10 + side * manner.tilt)
        fingers = (float(np.sin(angle)), float(np.cos(angle)), 0.12)
        palm = (0.12 * side, -0.12, 1.0)
        keys.append(ArmKey(time, _vector(wrist), fingers, palm, manner.shape, (0.85, -0.8, -0.15)))
    return keys


def _vector(values: np.ndarray) -> Vector:
    x, y, z = values.tolist()
    return x, y, z
