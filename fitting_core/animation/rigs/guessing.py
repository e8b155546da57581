"""Which joints of a rig are which parts of a body, guessed by name.

Known are the names of Mixamo, Unreal's mannequins, VRM and VRoid, Rigify, Character Creator, Daz and SMPL-X, and what
is plain enough: a side, a part and a number in any order and spelling.
"""

import re
from collections.abc import Iterable

from fitting_core.animation.rigs.parts import CHAINS, PARTS

_VENDORS = re.compile(r"^(.*[:|])?(mixamorig\d*|valvebiped|bip0*\d*|cc_base|j_bip|j_adj|def|base)?[ _.:-]*(?=\S)", re.I)
_WORDS = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+")
_SIDES = {"l": "left", "left": "left", "r": "right", "right": "right"}
_NOT_BONES = frozenset(
    "twist roll ik fk ctrl control pole end nub target helper mch org tweak leaf socket corrective top site".split()
)
_MIDDLE = {
    "pelvis": "pelvis hips hip",
    "spine": "spine chest upperchest lowerchest torso abdomen abdomenlower abdomenupper chestlower chestupper waist",
    "neck": "neck necklower neckupper necktwist",
    "head": "head",
    "jaw": "jaw jawroot",
}
_SIDED = {
    "collar": "clavicle collar collarbone",
    "shoulder": "upperarm uparm arm armupper shldr shldrbend",
    "elbow": "forearm lowerarm lowarm armlower elbow forearmbend",
    "wrist": "hand wrist",
    "hip": "upleg thigh upperleg legupper thighbend hip",
    "knee": "lowerleg shin calf leglower knee",
    "ankle": "ankle",
    "foot": "toebase toe toes ball",
    "eye": "eye",
}
_EITHER = {"shoulder": ("shoulder", "collar"), "leg": ("hip", "knee"), "foot": ("ankle", "foot")}
"""Words that mean two parts: the first that no other joint of this side has. SMPL-X's shoulder is the upper arm,
Mixamo's the clavicle."""
_FINGERS = {"thumb": "thumb", "index": "index", "middle": "middle", "mid": "middle", "ring": "ring"} | {
    "pinky": "pinky",
    "little": "pinky",
}
_PHALANGES = {"metacarpal": 0, "proximal": 1, "intermediate": 2, "distal": 3}
_RIGIFY = 7
"""Joints of Rigify's spine, which goes from the hips to the head."""


def guessed(names: Iterable[str]) -> dict[str, tuple[str, ...]]:
    """The parts found, and their joints: several for the chains, otherwise one.

    Args:
        names: Of the rig's joints, parents first.
    """
    found: dict[str, list[str]] = {}
    either: list[tuple[str, str, str]] = []
    thumbs: list[tuple[str, int, str]] = []
    for name in names:
        side, word, number = _read(name)
        if word in _FINGERS and side:
            finger = _FINGERS[word]
            if finger == "thumb":
                thumbs.append((side, number, name))
            elif 1 <= number <= 3:
                found.setdefault(f"{side}_{finger}{number}", []).append(name)
        elif side and word in _EITHER:
            either.append((side, word, name))
        elif part := _part(side, word):
            found.setdefault(part, []).append(name)
    _settle(found, either)
    _settle_thumbs(found, thumbs)
    _settle_rigify(found)
    return {part: tuple(found[part] if part in CHAINS else found[part][:1]) for part in PARTS if found.get(part, [])}


def _read(name: str) -> tuple[str, str, int]:
    """Side (or ""), the part's words in one, and a number (fingers: which phalanx; -1 where there is none)."""
    words = [word.lower() for word in _WORDS.findall(_VENDORS.sub("", name, count=1))]
    if _NOT_BONES & set(words) and "neck" not in words:  # Character Creator's neck is NeckTwist01
        return "", "", -1
    sides = [_SIDES[word] for word in words if word in _SIDES]
    phalanges = [_PHALANGES[word] for word in words if word in _PHALANGES]
    numbers = [int(word) for word in words if word.isdigit()]
    kept = [w for w in words if w not in _SIDES and w not in _PHALANGES and not w.isdigit() and w not in ("c", "f")]
    finger = next((word for word in kept if word in _FINGERS), None)
    if finger is not None and set(kept) <= {finger, "hand", "finger"}:
        kept = [finger]
    joined = "".join(kept)
    if not sides:  # lThighBend, Lthigh
        glued = re.fullmatch(r"(left|right)(.+)", joined)
        if glued:
            sides, joined = [glued[1]], glued[2]
    return sides[0] if sides else "", joined, (phalanges or numbers or [-1])[0]


def _part(side: str, word: str) -> str | None:
    if not side:
        if word in ("leye", "reye"):
            return {"leye": "left_eye", "reye": "right_eye"}[word]
        return next((part for part, words in _MIDDLE.items() if word in words.split()), None)
    return next((f"{side}_{part}" for part, words in _SIDED.items() if word in words.split()), None)


def _settle(found: dict[str, list[str]], either: list[tuple[str, str, str]]) -> None:
    """Resolve words that mean two parts."""
    for side, word, name in either:
        free = [part for part in _EITHER[word] if f"{side}_{part}" not in found]
        if free:
            found.setdefault(f"{side}_{free[0]}", []).append(name)


def _settle_thumbs(found: dict[str, list[str]], thumbs: list[tuple[str, int, str]]) -> None:
    """The joints of a thumb are three, whether they count from 0 or 1, from the metacarpal or the proximal."""
    for side in ("left", "right"):
        own = sorted((number, name) for of, number, name in thumbs if of == side and number >= 0)
        for place, (_, name) in enumerate(own[:3], 1):
            found[f"{side}_thumb{place}"] = [name]


def _settle_rigify(found: dict[str, list[str]]) -> None:
    """A spine that begins with the hips and ends with the head, as Rigify's does."""
    spine = found.get("spine", [])
    if "pelvis" not in found and len(spine) > 1:
        found["pelvis"], found["spine"] = spine[:1], spine[1:]
        if "head" not in found and len(spine) >= _RIGIFY:
            found["spine"], found["neck"], found["head"] = spine[1:4], spine[4:-1], spine[-1:]
