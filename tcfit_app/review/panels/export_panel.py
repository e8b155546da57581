"""The panel Export: files of the project and its fits, as downloads of the browser."""

from dataclasses import dataclass, replace
from typing import ClassVar, Literal, get_args

import viser

from fitting_core.errors import InputError
from fitting_core.io.motion.fitted_motion import AXES, OWN_WORLD
from tcfit_app.exports.exporting import content_of, file_name
from tcfit_app.exports.source import ExportedFit, ExportSource
from tcfit_app.exports.table import Export, Group, exports
from tcfit_app.fitting.fits import Shown, phase_title
from tcfit_app.project.frame_words import in_words, numbers
from tcfit_app.review.gestures.actions import Gestures
from tcfit_app.review.panels.elements.html import (
    Board,
    Html,
    button,
    choice,
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
from tcfit_app.review.tab.buttons import one_of
from tcfit_app.review.tab.on_show import OnShow, on_show
from tcfit_app.review.tab.state import TabState

Side = Literal["A", "B"]
_AXES = {"": "by format", "camera": "camera", "y-up": "y up", "z-up": "z up", OWN_WORLD: "calibration's"}
"""The last of them where the clip's camera stands in a world of the user's."""
_FRAMES = {"all": False, "selected": True}
"""Whether the selected frames alone are exported, by the button's value."""
_AXES_HINT = "As the programs expect that read the format: each button's hint says which"


@dataclass(frozen=True, kw_only=True)
class _Wishes:
    """What is exported, and how."""

    side: Side = "B"
    selected: bool = False
    """The selected frames alone."""
    axes: str = ""
    """A name of AXES, or OWN_WORLD; empty: what suits the format."""


class ExportPanel:
    """See `Panel`."""

    title: ClassVar[str] = "Export"
    icon: ClassVar[viser.IconName] = viser.Icon.DOWNLOAD

    def __init__(self, gestures: Gestures) -> None:
        self._tab = tab = gestures.tab
        self._wishes = _Wishes()
        self.running: Task[bytes] | None = None
        """The export that began last; its title is the file's name."""
        self._size = 0
        """Of its file, in bytes."""
        self._files, self._said = Board(tab), Board(tab)
        tab.buttons.on("export.begin", self._begin, lambda name: exports()[name])
        tab.buttons.on("export.cancel", lambda _: self._stop())
        tab.buttons.on("export.side", lambda side: self._wish(side=side), one_of(get_args(Side)))
        tab.buttons.on("export.frames", lambda on: self._wish(selected=on), _FRAMES.__getitem__)
        tab.buttons.on("export.axes", lambda axes: self._wish(axes=axes), one_of(_AXES))

    def _wish(self, **changes: object) -> None:
        self._wishes = replace(self._wishes, **changes)  # pyright: ignore[reportArgumentType]

    def _begin(self, export: Export) -> None:
        if self.running is not None and self.running.state == "running":
            raise InputError(f"{self.running.title} is still being made: wait for it, or cancel it.")
        tab = self._tab
        source = self._source(export)
        if export.needs != "keypoints":
            source.fit  # noqa: B018 - told before anything begins
        if (frames := self._frames) is not None and export.group != "Project":
            source = source[slice(frames.start, frames.stop)]
        name = file_name(export, "-".join([source.name, *self._parts(export)]), zipped=True)

        def work(report: Step) -> bytes:
            return content_of(export, source, lambda share: report("", share))

        self.running = tab.session.tasks.submit(name, work, owner=tab, then=self._send)

    def _send(self, made: Task[bytes]) -> None:
        if made.state == "finished":
            content = made.result()
            self._size = len(content)
            self._tab.client.send_file_download(made.title, content, save_immediately=True)

    def _parts(self, export: Export) -> list[str]:
        """What files of other runs, phases and frames are told apart by: without it they are the newest run's last
        phase, or what A | B shows at first, and the whole clip."""
        if export.group == "Project":
            return []
        tab, frames = self._tab, self._frames
        known = {} if export.needs == "keypoints" else {side: _short(f) for side, f in _fits(tab.shown).items()}
        shown = [name for side, name in known.items() if export.both or side == self._wishes.side]
        at_first = _fits(on_show(TabState(), tab.session))
        usual = [_short(fit) for side, fit in at_first.items() if export.both or side == "B"]
        some = [] if frames is None else [numbers(frames, tab.first_frame).replace("–", "-")]
        return [*(shown if shown != usual else []), *some]

    def _source(self, export: Export) -> ExportSource:
        """What there is, with the fits only where they are needed: their bodies may be missing."""
        tab, project = self._tab, self._tab.session.project
        fits = {} if export.needs == "keypoints" else {s: self._exported(f) for s, f in _fits(tab.shown).items()}
        return ExportSource(
            name=project.clip.name,
            chosen=fits.get(self._wishes.side),
            compared=list(fits.values()),
            known_clip=project.clip,
            project=tab.session.project.folder,
            axes=self._wishes.axes or None,
        )

    def _exported(self, shown: Shown) -> ExportedFit:
        tab = self._tab
        return ExportedFit(shown=shown, fit=tab.session.fits.fit(shown.run), meshes=tab.data.meshes(shown))

    @property
    def _frames(self) -> range | None:
        """The selected frames, if those alone are wished for."""
        return self._tab.state.frames if self._wishes.selected else None

    def _stop(self) -> None:
        if self.running is not None:
            self.running.cancel()

    # --- drawing ---

    def draw(self) -> None:
        """See `Panel.draw`."""
        tab, fits = self._tab, _fits(self._tab.shown)
        if tab.state.frames is None and self._wishes.selected:
            self._wish(selected=False)
        titles: dict[Side, str] = {side: fit.title for side, fit in fits.items()}
        if tab.sent.differs("exported", tuple(titles.items()), tab.state.frames, self._wishes):
            self._files.show(*self._choices(titles), *self._groups(titles))
        going = self.running
        if going is not None and tab.sent.differs(
            "export", going, going.state, going.stopping, round(100 * (going.share or 0.0)), self._size
        ):
            self._said.show(heading("Last file"), *_said(going, self._size))

    def _choices(self, titles: dict[Side, str]) -> list[Html]:
        """Which run, which frames, which axes."""
        wishes, tab = self._wishes, self._tab
        sides = [
            button(
                joined(dot(css(color)), *_named(side, titles.get(side, "none"))),
                "export.side",
                side,
                pressed=side == wishes.side,
                disabled=side not in titles,
                kind="left",
                hint=titles.get(side, ""),
            )
            for side, color in zip(get_args(Side), RUN_COLORS, strict=True)
        ]
        selected = tab.state.frames
        some = "selected" if selected is None else in_words(selected, tab.first_frame)
        frames = [
            button(label, "export.frames", value, pressed=wishes.selected == on, disabled=on and selected is None)
            for label, (value, on) in zip(("all", some), _FRAMES.items(), strict=True)
        ]
        axes = [
            button(label, "export.axes", value, pressed=wishes.axes == value, hint=_axes_hint(value))
            for value, label in _AXES.items()
            if value != OWN_WORLD or tab.session.project.clip.camera.world is not None
        ]
        return [
            heading("Files", "to this browser's downloads", first=True),
            row(choice(sides[0]), label="Run") if titles else paragraph(words("No fit yet: see the panel Fit.", "dim")),
            row(choice(sides[1]), label=" ") if titles else Html(),
            row(choice(*frames), label="Frames"),
            row(choice(*axes), label="Axes"),
        ]

    def _groups(self, titles: dict[Side, str]) -> list[Html]:
        """The formats, by group."""
        there = self._wishes.side in titles
        rows = []
        for group in get_args(Group):
            buttons = [
                button(
                    export.title,
                    "export.begin",
                    name,
                    disabled=export.needs != "keypoints" and not there,
                    hint=export.hint,
                )
                for name, export in exports().items()
                if export.group == group
            ]
            rows.append(row(tag("div", joined(*buttons), class_="tcfit-cells"), label=group))
        return [heading("Formats"), *rows]


def _fits(shown: OnShow) -> dict[Side, Shown]:
    """A and B, as far as they are there."""
    both: dict[Side, Shown | None] = {"A": shown.a, "B": shown.b}
    return {side: fit for side, fit in both.items() if fit is not None}


def _named(side: Side, title: str) -> list[Html]:
    """A fit on a button. Where its run's name is too long for it, the phase stays in sight."""
    name, _, phase = title.rpartition(" · ")
    return [words(f"{side}: ", "phase"), words(name or phase, "name"), words(f" · {phase}" if name else "", "phase")]


def _short(shown: Shown) -> str:
    """A run and phase in a file's name: "run2-temporal"."""
    run = f"run{shown.run.id}"
    return run if shown.run.kind == "imported" else f"{run}-{phase_title(shown.run, shown.phase).replace(' ', '-')}"


def _axes_hint(name: str) -> str:
    if not name:
        return _AXES_HINT
    text = "As the camera file has it" if name == OWN_WORLD else AXES[name].text
    return f"{text}; counts for SMPL-X npz, BVH, OBJ and PLY"


def _said(going: Task[bytes], size: int) -> list[Html]:
    """How far an export is, or how it ended."""
    name = words(going.title, "strong")
    if going.state == "failed":
        return [paragraph(joined(name, text(" could not be made"))), paragraph(going.reason, "bad")]
    if going.state == "finished":
        sent = words("sent to the downloads", "good")
        return [paragraph(joined(name, text(": "), sent, text(f" ({_size(size)})")))]
    if going.state == "cancelled":
        return [paragraph(joined(name, text(": cancelled")))]
    doing = " is being stopped …" if going.stopping else f" is being made … {going.share or 0.0:.0%}"
    return [
        paragraph(joined(name, text(doing))),
        progress_bar(going.share or 0.0),
        row(button("Cancel", "export.cancel", disabled=going.stopping, kind="danger")),
    ]


def _size(count: int) -> str:
    return f"{count / 1e6:.1f} MB" if count >= 1e6 else f"{max(1, round(count / 1e3))} kB"
