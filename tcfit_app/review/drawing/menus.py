"""The menus of timeline and picture."""

from collections.abc import Collection

from fitting_core.body.handshapes import HANDSHAPES
from fitting_core.keypoints import BODY, GROUPS, PARTS
from tcfit_app.project.frame_words import in_words
from tcfit_app.review.browser.page_states import Groups, MenuItem, Menus
from tcfit_app.review.gestures.actions import ACTIONS, OF_SELECTION, Gestures
from tcfit_app.review.gestures.edit_words import part_name

_OF_FRAMES = (
    ("rerun", "Fit {}"),
    None,
    ("bad", "Mark bad or restore, {}"),
    ("reset", "Reset, {}"),
    ("interpolate", "Interpolate, {}"),
    ("copy", "Copy previous, {}"),
    None,
    ("swap_body", "Swap left and right, {}"),
    ("swap_hands", "Swap hands, {}"),
    None,
    ("detect", "Detect again, {}"),
    None,
    ("fine", "Looks fine on or off, {}"),
    ("flag", "Flag on or off, {}"),
    ("note", "Write a note, {}"),
)
"""Actions on the selected frames, in groups, with their labels."""
_OF_KEYPOINTS = (
    ("bad", "reset", "copy", "interpolate", "delete_key"),
    ("mirror_depth", "in_front", "behind", "clear_depth"),
    ("pin", "lock", "unlock"),
    ("shape",),
    ("zoom",),
)
_OF_PICTURE = (
    ("select", "undo", "redo"),
    ("detect", "frame"),
    ("fine", "flag", "note"),
    ("bodies", "keypoints", "outline", "side"),
    ("fit_view", "copy_link"),
)
_SHAPES = (*(f"shape_{name}" for name in (*HANDSHAPES, "other", "copied", "last")), "copy_shape", "free_hand")
_SUBMENUS: dict[str, tuple[str, dict[str, str]]] = {
    "detect": ("Detect again", {f"detect_{part}": part_name(part) for part in PARTS}),
    "frame": ("Detect in a rectangle", {f"frame_{part}": part_name(part) for part in PARTS}),
    "select": ("Select", {"all": "all on show"} | {f"select_{group}": group.replace("_", " ") for group in GROUPS}),
    "shape": ("Hand shape", {name: ACTIONS[name].title.removeprefix("Hand shape: ") for name in _SHAPES}),
}
"""Titles, and the actions with what they are called there."""


def menus(gestures: Gestures) -> Menus:
    """All menus in their current state."""
    return Menus(
        keypoints=tuple(_group(gestures, *names, but=OF_SELECTION) for names in _OF_KEYPOINTS),
        picture=tuple(_group(gestures, *names) for names in _OF_PICTURE),
        frames=_of_frames(gestures),
        timeline=_of_timeline(gestures),
        nobody=_nobody(gestures),
    )


def _of_frames(gestures: Gestures) -> Groups:
    tab, selected = gestures.tab, gestures.tab.state.frames
    if selected is None:
        return ()
    hit, groups = in_words(selected, tab.first_frame), [[]]
    for line in _OF_FRAMES:
        if line is None:
            groups.append([])
        else:  # the page goes to one of these frames first
            groups[-1].append(item(gestures, line[0], line[1].format(hit), but=("frames",)))
    return tuple(map(tuple, groups))


def _of_timeline(gestures: Gestures) -> Groups:
    about_frame = (_group(gestures, "fine", "flag", "note"), _group(gestures, "detect"))
    return (
        (item(gestures, "range_start"), item(gestures, "range_end")),
        *(() if gestures.tab.state.frames is not None else about_frame),
        _group(gestures, "copy_link"),
        _group(gestures, "fit"),
    )


def _nobody(gestures: Gestures) -> MenuItem | None:
    """What a click offers where no person was detected: while the person can be chosen, and in frames without them."""
    tab = gestures.tab
    session = tab.session
    there = session.project.corrected.confidence[tab.state.frame, BODY] > 0
    missing = session.project.has_detections and not there.any()
    if not missing and not session.can_choose_person:
        return None
    return item(gestures, "frame_person", "Nobody was detected here. Search here?")


def _group(gestures: Gestures, *names: str, but: Collection[str] = ()) -> tuple[MenuItem, ...]:
    return tuple(item(gestures, name, but=but) for name in names)


def item(gestures: Gestures, name: str, label: str = "", *, but: Collection[str] = ()) -> MenuItem:
    """A menu item for one of ACTIONS or _SUBMENUS, with the first of its keys.

    Args:
        gestures: Of the tab.
        name: Of the action.
        label: Its text; empty: its title.
        but: As in `Action.obstacle`.
    """
    if name in _SUBMENUS:
        title, known = _SUBMENUS[name]
        parts = tuple(item(gestures, action, own.capitalize(), but=but) for action, own in known.items())
        return MenuItem(label=label or title, more=parts, obstacle=parts[0].obstacle)
    action = ACTIONS[name]
    keys = next(map(str, action.keys), "")
    why = action.obstacle(gestures, but=but)
    return MenuItem(label=label or action.title, action=name, keys=keys, obstacle=why)
