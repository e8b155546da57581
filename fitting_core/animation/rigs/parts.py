"""The parts of a body that a rig's joints are mapped to, named after SMPL-X's joints."""

from fitting_core.body.model import JOINTS

CHAINS: dict[str, tuple[str, ...]] = {"spine": ("spine1", "spine2", "spine3"), "neck": ("neck",)}
"""Parts that rigs divide differently: any number of joints for these of SMPL-X, from bottom to top."""
_IN_CHAINS = {joint: part for part, joints in CHAINS.items() for joint in joints}
PARTS: tuple[str, ...] = tuple(dict.fromkeys(_IN_CHAINS.get(joint, joint) for joint in JOINTS))
"""The names in a mapping: pelvis, spine, neck, head, left_hip (the thigh), left_knee (the shin), ..."""
NEEDED: tuple[str, ...] = (
    "pelvis",
    "spine",
    *(
        f"{side}_{part}"
        for side in ("left", "right")
        for part in ("hip", "knee", "ankle", "shoulder", "elbow", "wrist")
    ),
)
"""Required to move a body onto a rig."""
MEANT: dict[str, str] = {
    "pelvis": "hips",
    "spine": "spine, from below to above",
    "neck": "neck, from below to above",
    "collar": "clavicle",
    "shoulder": "upper arm",
    "elbow": "forearm",
    "wrist": "hand",
    "hip": "thigh",
    "knee": "shin",
    "ankle": "foot",
    "foot": "toes",
}
"""The bone that begins at a joint, in a word, where its name is another; sides left out."""


def meant(part: str) -> str:
    """A part in an animator's words: left thigh for left_hip."""
    side, _, rest = part.partition("_")
    if side not in ("left", "right"):
        return MEANT.get(part, part)
    return f"{side} {MEANT.get(rest, rest)}"


def below(part: str) -> str | None:
    """The needed part that a part of a limb hangs on; None for others."""
    side, _, rest = part.partition("_")
    above = {"knee": "hip", "ankle": "knee", "foot": "ankle", "elbow": "shoulder", "wrist": "elbow"}.get(rest)
    if above is None and rest[-1:].isdigit():
        above = "wrist"
    return None if above is None else f"{side}_{above}"
