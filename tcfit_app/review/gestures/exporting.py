"""Exports of what is on show, as downloads of one browser tab."""

import re
from dataclasses import dataclass, replace
from functools import cached_property, partial

from fitting_core.errors import InputError
from tcfit_app.exports.exporting import content_of, file_name
from tcfit_app.exports.source import ExportedFit, ExportSource
from tcfit_app.exports.table import VIEW_CHOICES, Export, exports
from tcfit_app.fitting.fits import FitChoice, Shown
from tcfit_app.project.frame_words import numbers
from tcfit_app.project.storage.run_record import newest
from tcfit_app.review.session.tasks import Step
from tcfit_app.review.tab.on_show import SLOTS, OnShow, Slot, on_show
from tcfit_app.review.tab.state import TabState
from tcfit_app.review.tab.tab import LONG, SHORT, OneTask, Tab


@dataclass(frozen=True, kw_only=True)
class Wishes:
    """What all formats are written with."""

    side: Slot = "b"
    """Which of two fits that are compared."""
    selected: bool = False
    """Only the selected frames."""
    axes: str = ""
    """A name of AXES, or OWN_WORLD; empty: the format's default."""
    view: str = ""
    """Of VIEW_CHOICES."""


class Exporting:
    """Writes exports for one tab, one at a time."""

    def __init__(self, tab: Tab) -> None:
        self._tab = tab
        self.wishes = Wishes()
        self.task = OneTask(tab)

    @cached_property
    def formats(self) -> dict[str, Export]:
        """All formats, by name."""
        return exports()

    def wish(self, **changes: object) -> None:
        """Change the wishes; names and values as in Wishes."""
        self.wishes = replace(self.wishes, **changes)  # pyright: ignore[reportArgumentType]

    @property
    def frames(self) -> range | None:
        """The selected frames, if only those are to be exported."""
        return self._tab.state.frames if self.wishes.selected else None

    @property
    def fits(self) -> dict[Slot, Shown]:
        """The finished fits on show; instead of one that is still being fitted, the newest finished one."""
        return self._done(self._tab.shown)

    def _done(self, shown: OnShow) -> dict[Slot, Shown]:
        session, found = self._tab.session, _finished(shown)
        done = [] if "b" in found else [run for run in session.fits.showable() if run.state == "finished"]
        last = session.stored.show(FitChoice(run=newest(done).id)) if done else None
        return found if last is None else {**found, "b": last}

    def _of(self, export: Export) -> dict[Slot, Shown]:
        """The fits that a format needs: their bodies may be missing."""
        if export.needs == "keypoints":
            return {}
        tab = self._tab
        return self._done(on_show(replace(tab.state, mode="ab"), tab.session)) if export.both else self.fits

    @property
    def compared(self) -> bool:
        """Whether there are two fits to choose from."""
        return self._tab.state.mode == "ab" and len({fit.version for fit in self.fits.values()}) > 1

    @property
    def side(self) -> Slot:
        """The fit that is exported."""
        return self.wishes.side if self.compared else "b"

    def missing(self, name: str) -> str:
        """What must be installed for a format; looked up once, as it stays so until a restart."""
        return self._tab.once(f"needs of {name}", None, self.formats[name].missing)

    def refuse(self, name: str) -> None:
        """Raises InputError if a format cannot be written now."""
        if missing := self.missing(name):
            raise InputError(missing)
        if self.formats[name].needs != "keypoints" and self.side not in self.fits:
            raise InputError("There is no finished fit to export yet: fit everything first.")

    def begin(self, name: str) -> None:
        """Write a format, and send it to the browser. Raises InputError if it cannot be written now."""
        self.refuse(name)
        self.task.refuse()
        export, frames = self.formats[name], self.frames
        source = self.source(export)
        if frames is not None:
            source = source[slice(frames.start, frames.stop)]
        file = file_name(export, "-".join([source.name, *self._parts(export)]), zipped=True)

        def work(report: Step) -> tuple[bytes, str | None]:
            return content_of(export, source, lambda share: report("being written", share))

        self.task.begin(file, work, partial(self._download, file))

    def _download(self, file: str, made: tuple[bytes, str | None]) -> None:
        content, note = made
        self._tab.client.send_file_download(file, content, save_immediately=True)
        self._tab.say(". ".join(filter(None, (f"{file}: downloaded", note))), LONG if note else SHORT)

    def _parts(self, export: Export) -> list[str]:
        """What tells apart file names of other fits and frames; nothing for the newest fit (or the two that Compare
        begins with) and the whole clip."""
        tab, frames = self._tab, self.frames
        known = {side: _short(fit) for side, fit in self._of(export).items()}
        shown = [name for side, name in known.items() if export.both or side == self.side]
        at_first = _finished(on_show(TabState(mode="ab"), tab.session))
        usual = [_short(fit) for side, fit in at_first.items() if export.both or side == "b"]
        part = [] if frames is None else [numbers(frames, tab.first_frame).replace("–", "-")]
        return [*(shown if shown != usual else []), *part]

    def source(self, export: Export) -> ExportSource:
        """What to export, with its fits."""
        tab, session, project = self._tab, self._tab.session, self._tab.session.project
        fits = {
            side: ExportedFit(shown=fit, fit=session.fits.fit(fit.run), meshes=tab.data.meshes(fit))
            for side, fit in self._of(export).items()
        }
        return ExportSource(
            name=project.footage.name,
            chosen=fits.get(self.side),
            compared=list(fits.values()),
            known_clip=project.clip,
            project=project.folder,
            axes=self.wishes.axes or None,
            views=VIEW_CHOICES[self.wishes.view][1],
        )


def _finished(shown: OnShow) -> dict[Slot, Shown]:
    return {side: fit for side in SLOTS if (fit := shown.fit(side)) is not None and fit.result is not None}


def _short(shown: Shown) -> str:
    """A fit for a file name: "fit2", "frames-60-100-smoother-w_T-1000"."""
    return re.sub(r"[^\w.]+", "-", shown.title.replace("Fit ", "fit").replace("Frame", "frame")).strip("-")
