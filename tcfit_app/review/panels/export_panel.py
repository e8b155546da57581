"""The Export panel: files of the project and its fits, as browser downloads."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, ClassVar, get_args

import viser

from fitting_core.motion import AXES, OWN_WORLD
from tcfit_app.exports.table import AXES_CHOICES, PROGRAMS, VIEW_CHOICES, VIEW_HINT, Group
from tcfit_app.project.frame_words import in_words
from tcfit_app.review.gestures.actions import Gestures, refusal
from tcfit_app.review.gestures.edit_words import capitalized
from tcfit_app.review.panels.elements.fold import Fold
from tcfit_app.review.panels.elements.html import (
    Board,
    Html,
    action,
    button,
    choice,
    heading,
    joined,
    paragraph,
    row,
    tag,
    words,
)

_AXES_HINT = "As the target programs expect; each button's tooltip says which"


class ExportPanel:
    """See `Panel`."""

    title: ClassVar[str] = "Export"
    icon: ClassVar[viser.IconName] = viser.Icon.DOWNLOAD

    def __init__(self, gestures: Gestures) -> None:
        self._gestures, self._tab, self._exporting = gestures, gestures.tab, gestures.exporting
        self._programs = Board(gestures.tab)
        self._formats_fold = Fold(gestures.tab, "export.formats")
        with self._formats_fold:
            self._formats = Board(gestures.tab)
        self._axes_fold = Fold(gestures.tab, "export.axes")
        with self._axes_fold:
            self._axes = Board(gestures.tab)

    def draw(self) -> None:
        """See `Panel.draw`."""
        if self._tab.state.frames is None and self._exporting.wishes.selected:
            self._exporting.wish(selected=False)
        self._programs.show(heading("For which program?", first=True), *self._parts(), *self._of_programs())
        self._formats.show(*(self._of_formats() if self._formats_fold.draw("All formats") else []))
        self._axes.show(*(self._of_axes() if self._axes_fold.draw(self._axes_title()) else []))

    def _parts(self) -> list[Html]:
        """Which of two fits, and which frames; nothing where there is no choice."""
        exporting, wishes, shown = self._exporting, self._exporting.wishes, []
        if exporting.compared:
            fits = {side: f"{side.upper()}: {fit.title_with_pass}" for side, fit in exporting.fits.items()}
            shown += self._choices("side", fits, exporting.side, kind="tall")
        elif (fit := exporting.fits.get("b")) is None:
            shown += [paragraph("There is no finished fit yet."), row(action(self._gestures, "panel_fit", "Go to Fit"))]
        elif fit is not self._tab.shown.b:
            shown.append(paragraph(f"{fit.title}: the last finished fit", "dim"))
        if (selected := self._tab.state.frames) is not None:
            parts = {False: "Whole clip", True: capitalized(in_words(selected, self._tab.first_frame))}
            shown.append(row(choice(*self._choices("selected", parts, wishes.selected))))
        return shown

    def _choices(
        self,
        wish: str,
        values: Mapping[Any, object],
        now: object,
        *,
        hint: Callable[[str], str] = lambda value: "",
        kind: str = "",
    ) -> list[Html]:
        """A button for each value of one of the `Wishes`."""
        return [
            button(
                label,
                f"export.{wish}",
                f"{value}",
                do=partial(self._exporting.wish, **{wish: value}),
                pressed=value == now,
                hint=hint(value),
                kind=kind,
            )
            for value, label in values.items()
        ]

    def _button(self, name: str, label: object, hint: str, kind: str = "") -> Html:
        why = refusal(self._exporting.refuse, name)
        do = partial(self._exporting.begin, name)
        return button(label, "export.begin", name, do=do, obstacle=why, hint=hint, kind=kind)

    def _of_programs(self) -> list[Html]:
        made, formats = [], self._exporting.formats
        for program, texts in PROGRAMS.items():
            there = (name for name in texts if not self._exporting.missing(name))
            name = next(there, next(iter(texts)))
            label = joined(words(program, "strong"), words(texts[name], "dim"))
            made.append(self._button(name, label, formats[name].hint, kind="tall"))
        return made

    def _of_formats(self) -> list[Html]:
        made, formats = [], self._exporting.formats
        for group in get_args(Group):
            buttons = [
                self._button(name, export.title, export.hint)
                for name, export in formats.items()
                if export.group == group
            ]
            made += [paragraph(group, "dim"), tag("div", joined(*buttons), class_="tcfit-cells")]
        return made

    def _axes_title(self) -> str:
        wishes = self._exporting.wishes
        changed = [AXES_CHOICES[wishes.axes]] if wishes.axes else []
        changed += [VIEW_CHOICES[wishes.view][0]] if wishes.view else []
        return f"Axes and view{': ' if changed else ''}{', '.join(changed)}"

    def _of_axes(self) -> list[Html]:
        wishes, own_world = self._exporting.wishes, self._tab.session.project.footage.camera.world is not None
        known = {value: label for value, label in AXES_CHOICES.items() if value != OWN_WORLD or own_world}
        axes = self._choices("axes", known, wishes.axes, hint=_axes_hint)
        labels = {value: label for value, (label, _) in VIEW_CHOICES.items()}
        views = self._choices("view", labels, wishes.view, hint=lambda value: VIEW_HINT)
        return [row(choice(*axes), label="Axes"), row(choice(*views), label="View")]


def _axes_hint(name: str) -> str:
    if not name:
        return _AXES_HINT
    text = "As in the camera file" if name == OWN_WORLD else AXES[name].text
    return f"{text}; applies to motions, meshes, TRC and C3D"
