"""The user's own rig: its file from the browser, the mapping of its joints, and exports of the fit on it."""

from functools import partial
from pathlib import Path
from typing import Any

import viser

from fitting_core.animation.rigs.mapping import check_joints
from fitting_core.animation.rigs.parts import CHAINS, NEEDED, PARTS, meant
from tcfit_app.exports.table import exports
from tcfit_app.fitting.reports import Notice
from tcfit_app.project.storage.rig import KeptRig
from tcfit_app.review.gestures.actions import refusal
from tcfit_app.review.panels.elements.field import Dropdown, Field, upload_button
from tcfit_app.review.panels.elements.html import Board, Html, button, paragraph, row
from tcfit_app.review.tab.tab import Tab

_NONE = "none"
_SAID = (
    "Your own character or skeleton (.glb, .gltf, .vrm or .bvh) follows the fit. Joints are recognised by "
    "name: check the list, and correct it."
)
_FIRST = 20
"""Parts of the body, before those of face and fingers."""


class OwnRig:
    """A part of a panel.

    Args:
        tab: whose panel it is.
    """

    def __init__(self, tab: Tab) -> None:
        self._tab = tab
        self._shown: KeptRig | None = None
        """The rig whose joints the inputs offer."""
        self._inputs: dict[str, Field[str]] = {}
        self._handles: dict[str, Any] = {}
        self._lists: list[Any] = []
        gui = tab.client.gui
        self._folder = gui.add_folder("Own rig", expand_by_default=False)
        with self._folder:
            self._about = Board(tab)
            hint = "From this browser's computer: the rig as GLB, glTF, VRM or BVH. It is stored in the project."
            self._upload = upload_button(tab, "Upload a rig", self._begin, hint=hint)
        tab.buttons.on("rig.download", lambda _: self._download())

    @property
    def _kept(self) -> KeptRig | None:
        return self._tab.session.rig.kept

    @property
    def mapping(self) -> Path | None:
        """The mapping file, if the project has a rig."""
        return None if self._kept is None else self._kept.mapping

    def _begin(self, file: viser.UploadedFile) -> None:
        tab, rig = self._tab, self._tab.session.rig
        tab.refuse_read_only()
        rig.refuse_busy()
        name, content = file.name, file.content
        rig.reading = tab.begin("Reading the rig", lambda report: rig.keep(name, content), self._take, writes=True)

    def _take(self, kept: KeptRig) -> None:
        self._tab.session.tell(Notice(title=f"Rig added: {kept.rig.name}", text="", kind="done"))

    def _choose(self, part: str, value: str) -> None:
        """Map a part to another joint; a part that had this joint loses it."""
        self._tab.refuse_read_only()
        kept = self._kept
        if kept is None:
            return
        given = value.split(",") if part in CHAINS else [value]
        names = tuple(name for text in given if (name := text.strip()) and name != _NONE)
        joints = {
            other: left
            for other, had in kept.joints.items()
            if other != part and (left := tuple(name for name in had if name not in names))
        }
        self._tab.session.rig.map_to(joints | ({part: names} if names else {}))

    def _download(self) -> None:
        if (kept := self._kept) is not None:
            name = f"{Path(kept.rig.name).stem}.toml"
            self._tab.client.send_file_download(name, kept.mapping.read_bytes(), save_immediately=True)

    # --- drawing ---

    def draw(self, *, there: bool) -> None:
        """Send what changed.

        Args:
            there: whether there is a fit to export.
        """
        session, kept = self._tab.session, self._kept
        if kept is not None and (self._shown is None or self._shown.skeleton is not kept.skeleton):
            self._make_inputs(kept)
        off = session.project.read_only or session.rig.busy
        self._upload.disabled = off
        self._tab.once("own rig", (kept, off), lambda: self._draw_inputs(kept, off=off))  # 55 of them
        self._about.show(paragraph(_SAID, "dim"), *self._told(there))

    def _draw_inputs(self, kept: KeptRig | None, *, off: bool) -> None:
        joints = {} if kept is None else kept.joints
        for part, field in self._inputs.items():
            field.show(_value(kept, part))
            self._handles[part].label = _label(part, missing=part not in joints)
            self._handles[part].disabled = off

    def _make_inputs(self, kept: KeptRig) -> None:
        """A list of joints for each part."""
        gui, offered = self._tab.client.gui, (_NONE, *dict.fromkeys(kept.skeleton.offered))
        for made in self._lists:
            made.remove()
        self._inputs, self._handles = {}, {}
        with self._folder:
            self._lists = [
                gui.add_folder(name, expand_by_default=False) for name in ("Its body", "Its face and fingers")
            ]
        for k, part in enumerate(PARTS):
            hint = f"SMPL-X's {part}" + (", needed" if part in NEEDED else "")
            take, value = partial(self._choose, part), _value(kept, part)
            label = _label(part, missing=part not in kept.joints)
            with self._lists[k >= _FIRST]:
                if part in CHAINS:
                    several = f"{hint}; any number of joints, separated by commas"
                    handle: Any = gui.add_text(label, value, hint=several)
                    self._inputs[part] = Field(self._tab, handle, take)
                else:
                    handle = gui.add_dropdown(label, offered, initial_value=value, hint=hint)
                    self._inputs[part] = Dropdown(self._tab, handle, take)
            self._handles[part] = handle
        self._shown = kept

    def _told(self, there: bool) -> list[Html]:
        """What the rig is, what is missing, and the exports."""
        if problem := self._tab.session.rig.problem:
            return [paragraph(f"The project's rig cannot be read: {problem} Upload it again.", "bad")]
        kept = self._kept
        if kept is None:
            return []
        wrong = refusal(check_joints, kept.joints, kept.skeleton)
        found = sum(part in kept.joints for part in PARTS)
        about = f"{kept.rig.name}: {len(kept.skeleton.offered)} joints, {found} of {len(PARTS)} parts mapped."
        bvh = kept.rig.suffix.lower() == ".bvh"
        files = [
            button(
                export.title,
                "export.begin",
                name,
                disabled=bool(wrong) or not there or (bvh and name == "rig-glb"),
                hint="The rig is a BVH file, which has no mesh" if bvh and name == "rig-glb" else export.hint,
            )
            for name, export in exports().items()
            if export.own_rig
        ]
        mapping = button("Mapping file", "rig.download", hint="For tcfit export --rig, beside the rig's file")
        return [paragraph(about), *([paragraph(wrong, "bad")] if wrong else []), row(*files, mapping, wrap=True)]


def _value(kept: KeptRig | None, part: str) -> str:
    """What an input shows; an edited mapping may name joints that do not exist."""
    names = () if kept is None else kept.joints.get(part, ())
    if part in CHAINS:
        return ", ".join(names)
    return names[0] if kept is not None and names and names[0] in kept.skeleton.offered else _NONE


def _label(part: str, *, missing: bool) -> str:
    side, _, rest = part.partition("_")
    words = meant(part) if meant(part) != part or side not in ("left", "right") else f"{side} {rest}"
    words = words.partition(",")[0]
    if words[-1:].isdigit():
        words = f"{words[:-1]} {words[-1]}"
    return f"{words} – missing" if missing and part in NEEDED else words
