"""Commands and options that were removed, with what replaces them."""

from collections.abc import Sequence

from fitting_core.errors import InputError

REMOVED = {
    "render": "Use tcfit export PATH --formats picture, sheet or overlay; --view camera side draws both views.",
    "export --rig": "Export mixamo, unreal, vrma, glb or bvh and retarget it to your character with the tools that "
    "docs/retargeting.md lists.",
    "export --keys": "Every frame has a key. Reduce keyframes in your program: in Blender, "
    "Graph Editor › Key › Decimate; in Maya, Curves › Simplify.",
}
"""What to do instead, by the command, with the option if only that was removed."""


def check_removed(given: Sequence[str]) -> None:
    """Raises InputError, which names the replacement, if a command line uses a removed command or option."""
    command = given[0] if given else ""
    for used in (command, *(f"{command} {word.partition('=')[0]}" for word in given[1:] if word.startswith("--"))):
        if instead := REMOVED.get(used):
            raise InputError(f"tcfit {used} was removed. {instead}")
