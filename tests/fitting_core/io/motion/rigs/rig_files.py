"""Rigs as files, written by hand: a BVH and a glTF of a person in T pose, with names of Mixamo."""

import json
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any

PERSON: tuple[tuple[str, str, tuple[float, float, float]], ...] = (
    ("Hips", "", (0, 100, 0)),
    ("Spine", "Hips", (0, 12, -1)),
    ("Spine1", "Spine", (0, 16, -2)),
    ("Neck", "Spine1", (0, 22, 1)),
    ("Head", "Neck", (0, 10, 1)),
    *(
        bone
        for side, x in (("Left", 1), ("Right", -1))
        for bone in (
            (f"{side}Shoulder", "Spine1", (5 * x, 17, 0)),
            (f"{side}Arm", f"{side}Shoulder", (12 * x, 0, -2)),
            (f"{side}ForeArm", f"{side}Arm", (33 * x, 0, 0)),
            (f"{side}Hand", f"{side}ForeArm", (22 * x, 0, 0)),
            (f"{side}HandIndex1", f"{side}Hand", (10 * x, 0, 3)),
            (f"{side}HandIndex2", f"{side}HandIndex1", (4 * x, 0, 0)),
            (f"{side}HandIndex3", f"{side}HandIndex2", (3 * x, 0, 0)),
            (f"{side}HandPinky1", f"{side}Hand", (9 * x, 0, -3)),
            (f"{side}UpLeg", "Hips", (11 * x, -5, 0)),
            (f"{side}Leg", f"{side}UpLeg", (0, -38, 1)),
            (f"{side}Foot", f"{side}Leg", (0, -48, -2)),
            (f"{side}ToeBase", f"{side}Foot", (0, -7, 14)),
        )
    ),
)
"""Name, parent, and offset from it in centimetres. Legs and arms are not in a body's proportions."""
Bones = Sequence[tuple[str, str, tuple[float, float, float]]]


def bvh_text(bones: Bones = PERSON) -> str:
    """A BVH of it, with one frame."""

    def joint(name: str, indent: str) -> list[str]:
        parent, offset = next((above, offset) for own, above, offset in bones if own == name)
        channels = (
            "3 Zrotation Xrotation Yrotation"
            if parent
            else ("6 Xposition Yposition Zposition Zrotation Xrotation Yrotation")
        )
        lines = [f"{indent}{'JOINT' if parent else 'ROOT'} {name}", indent + "{", f"{indent}  OFFSET %g %g %g" % offset]
        lines.append(f"{indent}  CHANNELS {channels}")
        children = [own for own, above, _ in bones if above == name]
        for child in children:
            lines += joint(child, indent + "  ")
        if not children:
            lines += [f"{indent}  End Site", indent + "  {", f"{indent}    OFFSET 0 5 0", indent + "  }"]
        return [*lines, indent + "}"]

    values = " ".join(["0"] * (3 + 3 * len(bones)))
    return "\n".join(["HIERARCHY", *joint(bones[0][0], ""), "MOTION", "Frames: 1", "Frame Time: 0.04", values]) + "\n"


def gltf_document(bones: Bones = PERSON, *, scale: float = 0.01, skinned: bool = True) -> dict[str, Any]:
    """A glTF of it without a mesh; below an armature that scales it to metres."""
    names = [name for name, _, _ in bones]
    nodes: list[dict[str, Any]] = [{"name": "Armature", "scale": [scale] * 3, "children": [1]}]
    for name, _, offset in bones:
        children = [1 + names.index(own) for own, above, _ in bones if above == name]
        nodes.append({"name": name, "translation": list(offset)} | ({"children": children} if children else {}))
    document: dict[str, Any] = {"asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": nodes}
    if skinned:
        document["skins"] = [{"joints": list(range(1, len(nodes)))}]
    return document


def glb_bytes(document: dict[str, Any], data: bytes = b"") -> bytes:
    """A GLB of a document."""
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
    if data:
        chunks += struct.pack("<II", len(data), 0x004E4942) + data
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def with_mapping(folder: Path, rig: str, content: bytes | str, table: str = "") -> Path:
    """A rig and a mapping file beside it."""
    (folder / rig).write_bytes(content if isinstance(content, bytes) else content.encode())
    path = folder / "rig.toml"
    path.write_text(f'skeleton = "{rig}"\n\n[joints]\n{table}\n')
    return path
