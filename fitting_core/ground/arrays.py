"""A grounding as arrays, for npz files.

| key | shape | |
|---|---|---|
| gravity | (3,) | unit vector in camera axes along which things fall; of a camera that moves, all is in still space, \
the camera space of the first frame |
| gravity_deviation | () | standard deviation of its direction, degrees |
| ground | (4,) | unit normal (up) and offset in metres of the floor: normal · x + offset = 0 in camera space, so that \
the offset is the camera's height; NaN where nothing stands in view |
| ground_deviation | () | standard deviation of its height under the person, metres; NaN as well |
| ground_text | () | why the floor is missing, in English; else empty |
| contacts | (N, 2) | whether the left and the right foot stand |
| contact_probability | (N, 2) | that they do; 0 where the foot is not in the image |
| contacts_let_go | (N, 2) | whether a foot seems to stand and goes on in the image, so that it does not; files of \
earlier versions have none |
"""

import numpy as np

from fitting_core.ground.contacts import Contacts
from fitting_core.ground.gravity import Gravity
from fitting_core.ground.grounding import Grounding
from fitting_core.ground.plane import Ground

NAMES = (
    *("gravity", "gravity_deviation", "ground", "ground_deviation", "ground_text"),
    *("contacts", "contact_probability", "contacts_let_go"),
)


def grounding_arrays(grounding: Grounding | None) -> dict[str, np.ndarray]:
    """The arrays of the table above; none of them without a grounding."""
    if grounding is None:
        return {}
    gravity, ground, contacts = grounding.gravity, grounding.ground, grounding.contacts
    values = (
        -gravity.up,
        gravity.deviation,
        np.full(4, np.nan) if ground is None else np.append(ground.normal, ground.offset),
        np.nan if ground is None else ground.deviation,
        grounding.missing,
        contacts.standing,
        contacts.probability,
        contacts.let_go,
    )
    return {name: np.asarray(value) for name, value in zip(NAMES, values, strict=True)}


def grounding_from(arrays: dict[str, np.ndarray], frames: int) -> Grounding | None:
    """The grounding that `grounding_arrays` wrote; None if absent, as in files of earlier versions.

    Raises:
        KeyError: It is incomplete.
        ValueError: An array has the wrong shape, or an invalid value.
    """
    if not any(name in arrays for name in NAMES):
        return None
    arrays = {"contacts_let_go": np.zeros((frames, 2), bool)} | arrays
    shapes = dict(zip(NAMES, ((3,), (), (4,), (), (), *[(frames, 2)] * 3), strict=True))
    for name, shape in shapes.items():
        if arrays[name].shape != shape:
            raise ValueError(f"{name} has the shape {arrays[name].shape}, expected {shape}")
    up, plane = -arrays["gravity"].astype(float), arrays["ground"].astype(float)
    if not abs(np.linalg.norm(up) - 1) < 1e-3:
        raise ValueError(f"gravity is {(-up).tolist()}, expected a unit vector")
    known = bool(np.isfinite(plane).all())
    ground = Ground(normal=plane[:3], offset=float(plane[3]), deviation=float(arrays["ground_deviation"]))
    return Grounding(
        gravity=Gravity(up=up, deviation=float(arrays["gravity_deviation"])),
        contacts=Contacts(
            probability=arrays["contact_probability"].astype(float),
            standing=arrays["contacts"].astype(bool),
            let_go=arrays["contacts_let_go"].astype(bool),
        ),
        ground=ground if known else None,
        missing=str(arrays["ground_text"]),
    )
