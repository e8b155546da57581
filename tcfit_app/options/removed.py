"""Commands and options that were removed, with what replaces them."""

from collections.abc import Sequence

from fitting_core.errors import InputError

REMOVED: dict[tuple[str, str], str] = {
    (
        "export",
        "--rig",
    ): "Export mixamo, unreal, vrma, glb or bvh and retarget it to your character with the tools that "
    "docs/retargeting.md lists.",
}
"""What to do instead, by command and option; the option is empty if the whole command was removed."""


def check_removed(given: Sequence[str]) -> None:
    """Raises InputError, which names the replacement, if a command line uses a removed command or option."""
    command = given[0] if given else ""
    options = ("", *(word.partition("=")[0] for word in given[1:] if word.startswith("--")))
    for option in options:
        if instead := REMOVED.get((command, option)):
            raise InputError(f"{option or f'tcfit {command}'} was removed. {instead}")
