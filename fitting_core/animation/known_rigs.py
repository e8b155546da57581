"""The tables of the well-known rigs; `standard` gives the sources of their facts."""

from collections.abc import Iterator

from fitting_core.animation.retargeting import Source
from fitting_core.animation.standard import AHEAD, DOWN, LEFT, RIGHT, UP, Bone, Standard, Vector
from fitting_core.keypoints import FINGERS

_STRAIGHT: dict[str, Vector] = {
    f"left_{joint}": LEFT
    for joint in ("shoulder", "elbow", *(f"{finger}{k}" for finger in FINGERS if finger != "thumb" for k in (1, 2)))
}
"""Arms and fingers of a T pose."""


def _mixamo() -> Iterator[Bone]:
    def bone(
        name: str, parent: str, joint: str, along: Vector | str, hint: Vector, order: str, place: str = ""
    ) -> Bone:
        above = f"mixamorig:{parent}" if parent else ""
        source = Source(joint) if joint else None
        return Bone(
            name=f"mixamorig:{name}", parent=above, source=source, along=along, hint=hint, order=order, place=place
        )

    yield bone("Hips", "", "pelvis", UP, LEFT, "yx")
    yield bone("Spine", "Hips", "spine1", "bone", LEFT, "yx")
    yield bone("Spine1", "Spine", "spine2", "bone", LEFT, "yx")
    yield bone("Spine2", "Spine1", "spine3", "bone", LEFT, "yx")
    yield bone("Neck", "Spine2", "neck", "bone", LEFT, "yx")
    yield bone("Head", "Neck", "head", "parent", LEFT, "yx")
    yield bone("HeadTop_End", "Head", "", "parent", LEFT, "yx", "head top")
    yield bone("Jaw", "Head", "jaw", "parent", LEFT, "yx")
    yield bone("{Left}Eye", "Head", "left_eye", "parent", LEFT, "yx")
    yield bone("{Left}Shoulder", "Spine2", "left_collar", "bone", DOWN, "yz")
    yield bone("{Left}Arm", "{Left}Shoulder", "left_shoulder", "bone", DOWN, "yz")
    yield bone("{Left}ForeArm", "{Left}Arm", "left_elbow", "bone", DOWN, "yz")
    yield bone("{Left}Hand", "{Left}ForeArm", "left_wrist", "parent", DOWN, "yz")
    for finger in ("Thumb", "Index", "Middle", "Ring", "Pinky"):
        name = finger.lower()
        yield bone(f"{{Left}}Hand{finger}1", "{Left}Hand", f"left_{name}1", "bone", DOWN, "yz")
        yield bone(f"{{Left}}Hand{finger}2", f"{{Left}}Hand{finger}1", f"left_{name}2", "bone", DOWN, "yz")
        yield bone(f"{{Left}}Hand{finger}3", f"{{Left}}Hand{finger}2", f"left_{name}3", "parent", DOWN, "yz")
        tip = f"left_{name}3 left_{name}"
        yield bone(f"{{Left}}Hand{finger}4", f"{{Left}}Hand{finger}3", "", "parent", DOWN, "yz", tip)
    yield bone("{Left}UpLeg", "Hips", "left_hip", "bone", RIGHT, "yx")
    yield bone("{Left}Leg", "{Left}UpLeg", "left_knee", "bone", RIGHT, "yx")
    yield bone("{Left}Foot", "{Left}Leg", "left_ankle", "bone", RIGHT, "yx")
    yield bone("{Left}ToeBase", "{Left}Foot", "left_foot", AHEAD, RIGHT, "yx")
    yield bone("{Left}Toe_End", "{Left}ToeBase", "", "parent", RIGHT, "yx", "left_foot left_big_toe")


MIXAMO = Standard(
    title="Mixamo",
    bones=tuple(_mixamo()),
    directions=_STRAIGHT
    | {
        "left_thumb1": (0.769, -0.447, 0.458),
        "left_thumb2": (0.777, -0.447, 0.443),
        "left_hip": (0.0, -1.0, 0.008),
        "left_knee": (0.0, -0.998, -0.068),
    },
)


def _unreal() -> Iterator[Bone]:
    def bone(
        name: str,
        parent: str,
        source: str | Source | None,
        along: Vector | str,
        hint: Vector = RIGHT,
        place: tuple[str, str, float] | str = "",
    ) -> Bone:
        turned = Source(source) if isinstance(source, str) else source
        return Bone(name=name, parent=parent, source=turned, along=along, hint=hint, order="xy", place=place)

    yield Bone(name="root", parent="", source=None, along=LEFT, hint=UP, order="")
    yield bone("pelvis", "root", "pelvis", UP)
    yield bone("spine_01", "pelvis", "spine1", "bone")
    yield bone("spine_02", "spine_01", "spine2", "bone")
    yield bone("spine_03", "spine_02", "spine3", "bone")
    yield bone("neck_01", "spine_03", "neck", "bone")
    yield bone("head", "neck_01", "head", "parent")
    yield bone("jaw", "head", "jaw", "parent")
    yield bone("eye_{l}", "head", "left_eye", "parent")
    yield bone("clavicle_{l}", "spine_03", "left_collar", "bone", UP)
    yield bone("upperarm_{l}", "clavicle_{l}", "left_shoulder", "bone", UP)
    yield bone("lowerarm_{l}", "upperarm_{l}", "left_elbow", "bone", UP)
    yield bone("hand_{l}", "lowerarm_{l}", "left_wrist", _HAND[0], _HAND[1])
    for finger in ("thumb", "index", "middle", "ring", "pinky"):
        yield bone(f"{finger}_01_{{l}}", "hand_{l}", f"left_{finger}1", "bone", _HAND[1])
        yield bone(f"{finger}_02_{{l}}", f"{finger}_01_{{l}}", f"left_{finger}2", "bone", _HAND[1])
        yield bone(f"{finger}_03_{{l}}", f"{finger}_02_{{l}}", f"left_{finger}3", "parent", _HAND[1])
    twist = Source("left_wrist", share=0.5)
    yield bone("lowerarm_twist_01_{l}", "lowerarm_{l}", twist, "parent", place=("left_elbow", "left_wrist", 0.5))
    yield bone("upperarm_twist_01_{l}", "upperarm_{l}", None, "parent", place=("left_shoulder", "left_elbow", 0.02))
    yield bone("thigh_{l}", "pelvis", "left_hip", "-bone")
    yield bone("calf_{l}", "thigh_{l}", "left_knee", "-bone")
    yield bone("foot_{l}", "calf_{l}", "left_ankle", UP)
    yield bone("ball_{l}", "foot_{l}", "left_foot", AHEAD)
    yield bone("thigh_twist_01_{l}", "thigh_{l}", None, "parent", place=("left_hip", "left_knee", 0.5))
    yield bone("calf_twist_01_{l}", "calf_{l}", None, "parent", place=("left_knee", "left_ankle", 0.5))


_HAND: tuple[Vector, Vector] = ((0.508, -0.775, 0.375), (0.338, -0.221, -0.915))
"""The mannequin's left hand: along the fingers, and towards the little finger."""
UNREAL = Standard(
    title="Unreal mannequin",
    bones=tuple(_unreal()),
    directions={
        "left_shoulder": (0.746, -0.666, -0.017),
        "left_elbow": (0.639, -0.618, 0.459),
        "left_hip": (0.115, -0.993, -0.005),
        "left_knee": (0.083, -0.993, -0.083),
    },
    hand=_HAND,
    negated=True,
)


def _vrm() -> Iterator[Bone]:
    def bone(name: str, parent: str, joint: str) -> Bone:
        return Bone(name=name, parent=parent, source=Source(joint), along=LEFT, hint=UP, order="")

    yield bone("hips", "", "pelvis")
    yield bone("spine", "hips", "spine1")
    yield bone("chest", "spine", "spine2")
    yield bone("upperChest", "chest", "spine3")
    yield bone("neck", "upperChest", "neck")
    yield bone("head", "neck", "head")
    yield bone("jaw", "head", "jaw")
    yield bone("{left}Eye", "head", "left_eye")
    yield bone("{left}Shoulder", "upperChest", "left_collar")
    yield bone("{left}UpperArm", "{left}Shoulder", "left_shoulder")
    yield bone("{left}LowerArm", "{left}UpperArm", "left_elbow")
    yield bone("{left}Hand", "{left}LowerArm", "left_wrist")
    for finger in ("Thumb", "Index", "Middle", "Ring", "Little"):
        parts = ("Metacarpal", "Proximal", "Distal") if finger == "Thumb" else ("Proximal", "Intermediate", "Distal")
        joint = "left_" + {"Little": "pinky"}.get(finger, finger.lower())
        above = "{left}Hand"
        for k, part in enumerate(parts, 1):
            yield bone(f"{{left}}{finger}{part}", above, f"{joint}{k}")
            above = f"{{left}}{finger}{part}"
    yield bone("{left}UpperLeg", "hips", "left_hip")
    yield bone("{left}LowerLeg", "{left}UpperLeg", "left_knee")
    yield bone("{left}Foot", "{left}LowerLeg", "left_ankle")
    yield bone("{left}Toes", "{left}Foot", "left_foot")


VRM = Standard(
    title="VRM 1.0",
    bones=tuple(_vrm()),
    directions=_STRAIGHT
    | {"left_thumb1": (0.707, 0.0, 0.707), "left_thumb2": (0.707, 0.0, 0.707), "left_hip": DOWN, "left_knee": DOWN},
)
