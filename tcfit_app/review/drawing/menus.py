"""What the menus of timeline and picture offer."""

from fitting_core.keypoints import PARTS
from tcfit_app.project.frame_words import in_words
from tcfit_app.review.browser.page_states import FrameMenus, MenuItem, PictureMenus
from tcfit_app.review.gestures.actions import ACTIONS
from tcfit_app.review.gestures.detecting_again import can_look
from tcfit_app.review.gestures.edit_words import part_name
from tcfit_app.review.tab.tab import Tab


def frame_menus(tab: Tab) -> FrameMenus:
    """Both menus as things are now."""
    frames, fixed = tab.state.frames, tab.session.project.read_only
    unfit, unselected = fixed or tab.shown.b is None, fixed or not tab.state.selection
    elsewhere = (
        (item("range_start", "Select frames from here on"), item("range_end", "Select frames up to here")),
        *(() if frames is not None else (tuple(item(name, off=fixed) for name in ("fine", "flag", "note")),)),
        *(() if frames is not None else ((_again(tab),),)),
        (item("copy_link"),),
        (item("rerun_edited", off=unfit), item("fit", off=fixed)),
    )
    if frames is None:
        return FrameMenus(elsewhere=elsewhere)
    hit = in_words(frames, tab.first_frame)
    selected = (
        (item("rerun", f"Re-run {hit}", off=unfit),),
        (
            item("bad", f"Mark bad or restore, {hit}", off=unselected),
            item("reset", f"Reset, {hit}", off=unselected),
            item("interpolate", f"Interpolate, {hit}", off=unselected),
            item("copy", f"Copy previous, {hit}", off=unselected),
        ),
        (
            item("swap_body", f"Swap left and right, {hit}", off=fixed),
            item("swap_hands", f"Swap hands, {hit}", off=fixed),
        ),
        (_again(tab, f"Detect again, {hit}"),),
        (
            item("fine", f"Looks fine or not, {hit}", off=fixed),
            item("flag", f"Flag or not, {hit}", off=fixed),
            item("note", f"Write a note, {hit}", off=fixed),
        ),
    )
    return FrameMenus(selected=selected, elsewhere=elsewhere)


_ALWAYS = {"play", "zoom", "fit_view", "save_picture", "copy_link", "all", "bodies", "bones", "outline", "side"}
"""Actions of these menus that change nothing in the project."""
_OF_FITS = {"mirror_depth", "in_front", "behind", "pin", "lock"}


def picture_menus(tab: Tab) -> PictureMenus:
    """Both menus as things are now."""
    off = tab.session.project.read_only
    unfit = off or tab.shown.b is None

    def group(*names: str) -> tuple[MenuItem, ...]:
        return tuple(item(n, off=n not in _ALWAYS and (unfit if n in _OF_FITS else off)) for n in names)

    return PictureMenus(
        keypoints=(
            group("bad", "reset", "copy", "interpolate", "delete_key"),
            group("mirror_depth", "in_front", "behind", "clear_depth"),
            group("pin", "lock", "unlock"),
            group("zoom", "save_picture"),
        ),
        elsewhere=(
            group("all", "undo", "redo"),
            (_again(tab), _in_rectangle(tab)),
            group("fine", "flag", "note"),
            group("bodies", "bones", "outline", "side"),
            group("fit_view", "save_picture", "copy_link"),
        ),
    )


def _again(tab: Tab, label: str = "Detect again") -> MenuItem:
    return _by_part(tab, label, "detect")


def _in_rectangle(tab: Tab) -> MenuItem:
    return _by_part(tab, "Detect in a rectangle", "frame")


def _by_part(tab: Tab, label: str, verb: str) -> MenuItem:
    """Opens the menu of what can be looked for."""
    parts = tuple(MenuItem(label=part_name(part).capitalize(), action=f"{verb}_{part}") for part in PARTS)
    return MenuItem(label=label, more=parts, disabled=not can_look(tab))


def item(name: str, label: str = "", *, off: bool = False) -> MenuItem:
    """A line for one of ACTIONS, with the first of its keys; without a label its title."""
    action = ACTIONS[name]
    keys = str(action.keys[0]) if action.keys else ""
    return MenuItem(label=label or action.title, action=name, keys=keys, disabled=off)
