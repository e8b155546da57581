"""The Export panel: files of the project and its fits, as browser downloads."""

from dataclasses import dataclass, replace
from functools import partial
from typing import ClassVar, Literal, get_args

import viser

from fitting_core.errors import InputError
from fitting_core.motion import AXES, OWN_WORLD
from tcfit_app.exports.exporting import content_of, file_name
from tcfit_app.exports.source import ExportedFit, ExportSource
from tcfit_app.exports.table import AXES_CHOICES, VIEW_CHOICES, VIEW_HINT, Export, Group, exports
from tcfit_app.fitting.fits import Shown, phase_title
from tcfit_app.project.frame_words import in_words, numbers
from tcfit_app.review.gestures.actions import Gestures
from tcfit_app.review.panels.elements.html import (
    Board,
    Html,
    button,
    choice,
    choices,
    dot,
    heading,
    joined,
    paragraph,
    progress_bar,
    row,
    tag,
    text,
    words,
)
from tcfit_app.review.scene.layers import RUN_COLORS, css
from tcfit_app.review.session.tasks import Step, Task
from tcfit_app.review.tab.on_show import OnShow, on_show
from tcfit_app.review.tab.state import TabState

Letter = Literal["A", "B"]
_AXES_HINT = "As the target programs expect; each button's tooltip says which"


@dataclass(frozen=True, kw_only=True)
class _Wishes:
    side: Letter = "B"
    selected: bool = False
    """Only the selected frames."""
    axes: str = ""
    """A name of AXES, or OWN_WORLD; empty: the format's default."""
    view: str = ""
    """Of VIEW_CHOICES."""


class ExportPanel:
    """See `Panel`."""

    title: ClassVar[str] = "Export"
    icon: ClassVar[viser.IconName] = viser.Icon.DOWNLOAD

    def __init__(self, gestures: Gestures) -> None:
        self._gestures, self._tab = gestures, gestures.tab
        tab = gestures.tab
        self._wishes = _Wishes()
        self.running: Task[tuple[bytes, str | None]] | None = None
        """The export started last; its title is the file's name."""
        self._size = 0
        """Size of its file in bytes."""
        self._note = ""
        """A remark to show with it."""
        self._files = Board(tab)
        self._said = Board(tab)

    def _wish(self, **changes: object) -> None:
        self._wishes = replace(self._wishes, **changes)  # pyright: ignore[reportArgumentType]

    def _begin(self, export: Export) -> None:
        if self.running is not None and self.running.state == "running":
            raise InputError(f"{self.running.title} is still being made: wait for it, or cancel it.")
        source = self._source(export)
        if export.needs != "keypoints":
            source.fit  # noqa: B018 - raises before anything begins
        if (frames := self._frames) is not None and export.group != "Project":
            source = source[slice(frames.start, frames.stop)]
        name = file_name(export, "-".join([source.name, *self._parts(export)]), zipped=True)

        def work(report: Step) -> tuple[bytes, str | None]:
            return content_of(export, source, lambda share: report("", share))

        self.running = self._tab.session.tasks.submit(name, work, owner=self._tab, then=self._send)

    def _send(self, made: Task[tuple[bytes, str | None]]) -> None:
        if made.state == "finished":
            content, note = made.result()
            self._size, self._note = len(content), note or ""
            self._tab.client.send_file_download(made.title, content, save_immediately=True)

    def _parts(self, export: Export) -> list[str]:
        """What tells apart file names of other runs, phases and frames; nothing for the newest run's last phase (or the
        default A and B) of the whole clip."""
        if export.group == "Project":
            return []
        tab, frames = self._tab, self._frames
        known = {} if export.needs == "keypoints" else {side: _short(f) for side, f in _fits(tab.shown).items()}
        shown = [name for side, name in known.items() if export.both or side == self._wishes.side]
        at_first = _fits(on_show(TabState(), tab.session))
        usual = [_short(fit) for side, fit in at_first.items() if export.both or side == "B"]
        return [*(shown if shown != usual else []), *_in_file_name(frames, tab.first_frame)]

    def _source(self, export: Export) -> ExportSource:
        """What to export, with fits only where they are needed: their bodies may be missing."""
        tab, session, project = self._tab, self._tab.session, self._tab.session.project
        shown = {} if export.needs == "keypoints" else _fits(tab.shown)
        fits = {
            side: ExportedFit(shown=fit, fit=session.fits.fit(fit.run), meshes=tab.data.meshes(fit))
            for side, fit in shown.items()
        }
        return ExportSource(
            name=project.footage.name,
            chosen=fits.get(self._wishes.side),
            compared=list(fits.values()),
            known_clip=project.clip,
            project=project.folder,
            axes=self._wishes.axes or None,
            views=VIEW_CHOICES[self._wishes.view][1],
        )

    @property
    def _frames(self) -> range | None:
        """The selected frames, if only those are to be exported."""
        return self._tab.state.frames if self._wishes.selected else None

    # --- drawing ---

    def draw(self) -> None:
        """See `Panel.draw`."""
        tab, fits = self._tab, _fits(self._tab.shown)
        if tab.state.frames is None and self._wishes.selected:
            self._wish(selected=False)
        titles: dict[Letter, str] = {side: fit.title for side, fit in fits.items()}
        self._files.show(*self._choices(titles), *self._groups(titles))
        if self.running is not None:
            self._said.show(heading("Last file"), *_said(self.running, self._size, self._note))

    def _choices(self, titles: dict[Letter, str]) -> list[Html]:
        """Which run, which frames, which axes."""
        wishes, tab = self._wishes, self._tab
        labels = {
            side: joined(dot(css(color)), *_named(side, titles.get(side, "none")))
            for side, color in zip(get_args(Letter), RUN_COLORS, strict=True)
        }
        sides = choices(
            "export.side",
            labels,
            lambda side: self._wish(side=side),
            lambda side: side == wishes.side,
            disabled=lambda side: side not in titles,
            hint=lambda side: titles.get(side, ""),
            kind="left",
        )
        selected = tab.state.frames
        some = "selected" if selected is None else in_words(selected, tab.first_frame)
        frames = choices(
            "export.frames",
            {"all": "all", "selected": some},
            lambda value: self._wish(selected=value == "selected"),
            lambda value: wishes.selected == (value == "selected"),
            disabled=lambda value: value == "selected" and selected is None,
        )
        own_world = tab.session.project.footage.camera.world is not None
        axes = choices(
            "export.axes",
            {value: label for value, label in AXES_CHOICES.items() if value != OWN_WORLD or own_world},
            lambda value: self._wish(axes=value),
            lambda value: wishes.axes == value,
            hint=_axes_hint,
        )
        views = choices(
            "export.view",
            {value: label for value, (label, _) in VIEW_CHOICES.items()},
            lambda value: self._wish(view=value),
            lambda value: wishes.view == value,
            hint=lambda value: VIEW_HINT,
        )
        return [
            heading("Files", "to this browser's downloads", first=True),
            row(sides[0], label="Run") if titles else paragraph(words("No fit yet: see the panel Fit.", "dim")),
            row(sides[1], label=" ") if titles else Html(),
            row(choice(*frames), label="Frames"),
            row(choice(*axes), label="Axes"),
            row(choice(*views), label="View"),
        ]

    def _groups(self, titles: dict[Letter, str]) -> list[Html]:
        there = self._wishes.side in titles
        rows = []
        for group in get_args(Group):
            buttons = [
                button(
                    export.title,
                    "export.begin",
                    name,
                    do=partial(self._begin, export),
                    disabled=export.needs != "keypoints" and not there,
                    obstacle=missing,
                    hint=export.hint,
                )
                for name, export in exports().items()
                if export.group == group
                for missing in [self._tab.once(f"needs of {name}", None, export.missing)]  # it stays so until a restart
            ]
            if buttons:
                rows.append(row(tag("div", joined(*buttons), class_="tcfit-cells"), label=group))
        return [heading("Formats"), *rows]


def _fits(shown: OnShow) -> dict[Letter, Shown]:
    both: dict[Letter, Shown | None] = {"A": shown.a, "B": shown.b}
    return {side: fit for side, fit in both.items() if fit is not None}


def _named(side: Letter, title: str) -> list[Html]:
    """A fit as a button's label. If the run's name is too long, the phase stays visible."""
    name, _, phase = title.rpartition(" · ")
    return [words(f"{side}: ", "phase"), words(name or phase, "name"), words(f" · {phase}" if name else "", "phase")]


def _short(shown: Shown) -> str:
    """A run and phase for a file name: "run2-temporal"."""
    run = f"run{shown.run.id}"
    return run if shown.run.kind == "imported" else f"{run}-{phase_title(shown.run, shown.phase).replace(' ', '-')}"


def _in_file_name(frames: range | None, first_frame: int) -> list[str]:
    """Frames for a file name; nothing for all."""
    return [] if frames is None else [numbers(frames, first_frame).replace("–", "-")]


def _axes_hint(name: str) -> str:
    if not name:
        return _AXES_HINT
    text = "As in the camera file" if name == OWN_WORLD else AXES[name].text
    return f"{text}; applies to motions, meshes, TRC and C3D"


def _said(going: Task[tuple[bytes, str | None]], size: int, note: str) -> list[Html]:
    """The progress of an export, or how it ended."""
    name = words(going.title, "strong")
    if going.state == "failed":
        return [paragraph(joined(name, text(" could not be written"))), paragraph(going.reason, "bad")]
    if going.state == "finished":
        sent = words("downloaded", "good")
        remark = [paragraph(note, "dim")] if note else []
        return [paragraph(joined(name, text(": "), sent, text(f" ({_size(size)})"))), *remark]
    if going.state == "cancelled":
        return [paragraph(joined(name, text(": cancelled")))]
    doing = " is stopping …" if going.stopping else f" in progress … {going.share or 0.0:.0%}"
    return [
        paragraph(joined(name, text(doing))),
        progress_bar(going.share or 0.0),
        row(button("Cancel", "export.cancel", do=going.cancel, disabled=going.stopping, kind="danger")),
    ]


def _size(count: int) -> str:
    return f"{count / 1e6:.1f} MB" if count >= 1e6 else f"{max(1, round(count / 1e3))} kB"
