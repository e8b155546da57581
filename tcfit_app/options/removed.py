"""Commands and options that were removed, with what replaces them."""

from collections.abc import Sequence

from fitting_core.errors import InputError

SETTINGS = {
    "solver": "solver",
    "pose_prior": "pose_prior",
    "temporal": "temporal.mode",
    "temporal_space": "temporal.space",
    "shape_strategy": "shape_sample.strategy",
    "seed": "shape_sample.seed",
    "silhouettes": "silhouettes",
    "start_deviation": "start_deviation",
    "precision": "precision",
}
"""Settings that had options of their own, by option. Lists of clips may still have these columns."""
REMOVED = {
    **{
        f"{command} --{option.replace('_', '-')}": f"Use --set {setting}=VALUE."
        for command in ("fit", "batch", "demo", "settings")
        for option, setting in SETTINGS.items()
    },
    "batch --retry": "Leave it out: the same command fits failed clips again.",
    "batch --report": "See CLIPS.batch/summary.csv, or list the clips with tcfit review FOLDER.",
    "batch --projects": "tcfit review FOLDER opens each result as a project.",
    "demo --no-review": "Use tcfit demo, then tcfit evaluate tcfit-demo.tcfit.",
    "detect --list": "Use tcfit models.",
    "detect --batch": "Leave it out: it did not affect the result.",
    "detect --restart": "Delete the cached keypoints; docs/troubleshooting.md says where they are.",
    "detect --download": "Use tcfit models add NAME.",
    **{
        f"evaluate --{option}": "Import the result into a project with tcfit import, and evaluate that."
        for option in ("person", "body-model", "frame-rate")
    },
    "evaluate --pictures": "The report has no pictures. See the worst frames with tcfit review.",
    "import --vposer": "Use tcfit models add VPOSER.",
    "render": "Use tcfit export PATH --formats picture, sheet or overlay; --view camera side draws both views.",
    "export --rig": "Export mixamo, unreal, vrma, glb or bvh and retarget it to your character with the tools that "
    "docs/retargeting.md lists.",
    "export --zip": "Pack the folder with any archiver.",
    "export --keys": "Every frame has a key. Reduce keyframes in your program: in Blender, "
    "Graph Editor › Key › Decimate; in Maya, Curves › Simplify.",
}
"""What to do instead, by the command, with the option if only that was removed."""


def check_removed(given: Sequence[str]) -> None:
    """Raise InputError, which names the replacement, if a command line uses a removed command or option."""
    command = given[0] if given else ""
    for used in (command, *(f"{command} {word.partition('=')[0]}" for word in given[1:] if word.startswith("--"))):
        if instead := REMOVED.get(used):
            raise InputError(f"tcfit {used} was removed. {instead}")
