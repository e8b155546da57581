"""The fits of a project, as a list: which is on show, what can be done with each, and those that were deleted."""

from dataclasses import replace
from functools import partial
from pathlib import Path

import viser

from fitting_core.body.files.forms import KINDS
from fitting_core.errors import InputError
from tcfit_app.fitting.fits import FitChoice, pass_of, passes_of
from tcfit_app.imports.results import ImportChoices
from tcfit_app.project.storage.run_record import Run, by_name
from tcfit_app.review.gestures.actions import Gestures
from tcfit_app.review.panels.elements.field import Field, for_writers, frame_number
from tcfit_app.review.panels.elements.file_input import FileInput, TextRow
from tcfit_app.review.panels.elements.fold import Fold
from tcfit_app.review.panels.elements.html import (
    Board,
    Html,
    Item,
    action_item,
    button,
    heading,
    joined,
    line,
    menu_button,
    opener,
    paragraph,
    row,
    table,
    tag,
    words,
)
from tcfit_app.review.panels.fit.fit_settings import nearest_preset
from tcfit_app.review.panels.fit.fit_texts import Listed, details, errors_in_words, line_below, result_of, rows_of
from tcfit_app.review.session.tasks import Step
from tcfit_app.review.tab.on_show import SLOT_COLORS, SLOTS, Slot
from tcfit_app.review.tab.tab import Tab

LISTED = 5
"""The newest fits, listed at once; the others on request."""
_CONTINUE = "Fit everything with this fit's settings; the frames fitted so far are not fitted again"
_BADGES: dict[Slot, Html] = {
    side: tag("b", side.upper(), class_="tcfit-badge", style=f"border-color:var(--tcfit-{color})")
    for side, color in SLOT_COLORS.items()
}
_DETAILS = "fit.details"
"""In `TabState.folds` while they are shown."""


class FitList:
    """A part of the Fit panel."""

    def __init__(self, gestures: Gestures) -> None:
        self._gestures, self._tab = gestures, gestures.tab
        tab, gui = gestures.tab, gestures.tab.client.gui
        self._chosen: int | None = None
        """The run that was clicked although it has no result to show."""
        self._renamed: int | None = None
        """The run whose name is being changed."""
        self._all = False
        """All fits are listed."""
        self._errors: dict[int, str] = {}
        """Of fits that were on show, by run."""
        self._rows = Board(tab)
        self._naming = gui.add_folder(None, visible=False)
        with self._naming:
            self._name = gui.add_text("Name", "", hint="Type another name, then Enter or Rename")
            for_writers(tab, self._name)
            self._entered = Field(tab, self._name, lambda _: None)
            self._rename_buttons = Board(tab)
        self._details = Board(tab)
        self._deleted = DeletedFits(tab)

    def add_import(self) -> None:
        """Create the import of results, which is last in the panel."""
        self._import = ImportedFits(self._tab)

    # --- what is done ---

    def _run(self, number: int) -> Run:
        """The run that a button was for."""
        run = self._tab.session.fits.run(number)
        if run is None:
            raise InputError("This fit has been deleted; it can be restored below.")
        return run

    def _show(self, run: Run) -> None:
        """Show a fit; one without a result is chosen, but the other stays on show."""
        tab, there = self._tab, run in self._tab.session.fits.showable()
        self._chosen, self._renamed = None if there else run.id, None
        if there:
            other = tab.state.a
            tab.set(b=FitChoice(run=run.id), a=None if other is not None and other.run == run.id else other)

    def _list_all(self) -> None:
        self._all = True

    def _compare(self, run: Run, other: FitChoice | None) -> None:
        self._tab.set(mode="ab", a=other, b=FitChoice(run=run.id))

    def _begin_renaming(self, listed: Listed) -> None:
        self._tab.refuse_read_only()
        run = listed.run if listed.run.own_name else listed.base
        self._renamed = run.id
        self._entered.show(run.name)
        self._tab.show_panel("Fit", "Name")

    def _rename(self, number: int) -> None:
        self._tab.refuse_read_only()
        self._tab.session.project.runs.rename(self._run(number).id, self._name.value)
        self._renamed = None
        self._tab.say("Renamed")

    def _stop_renaming(self) -> None:
        self._renamed = None

    def _delete(self, listed: Listed) -> None:
        self._tab.refuse_read_only()
        for run in dict.fromkeys((listed.base.id, listed.run.id)):
            self._tab.session.delete(self._run(run).id)
        self._chosen = self._renamed = None
        self._tab.say(f"Deleted: {listed.run.name}; it can be restored below")

    def _use_settings(self, number: int) -> None:
        tab, run = self._tab, self._run(number)
        if run.stored and tab.session.stored.reading(run):
            raise InputError(f"{run.name} is still being read: try again in a moment.")
        fit, clip = result_of(tab.session, run), tab.session.project.footage.camera
        focal = fit.camera.focal[0] if fit is not None and fit.camera.focal != clip.focal else None
        settings = replace(
            tab.state.settings,
            config=run.config,
            preset=nearest_preset(run.config),
            kind=run.body.kind,
            gender=run.body.gender,
            focal=focal,
            given=run.given,
            problems=(),
        )
        tab.set(settings=settings)
        tab.say(f"The next fit uses the settings of {run.name}")

    def _turn_details(self) -> None:
        self._tab.set(folds=self._tab.state.folds ^ {_DETAILS})

    # --- drawing ---

    def draw(self) -> None:
        """Send what changed."""
        tab, session = self._tab, self._tab.session
        rows, shown = rows_of(session), tab.shown
        self._learn_errors()
        there = {fit.run.id for fit in (shown.a, shown.b) if fit is not None}
        on_show = [one for one in rows if {one.run.id, one.base.id} & there]
        here = next((one for one in rows if one.base.id == self._chosen), None)
        here = here or next((one for one in on_show if shown.b and shown.b.run.id in (one.run.id, one.base.id)), None)
        listed = [one for i, one in enumerate(rows) if self._all or i < LISTED or one in on_show or one is here]
        lines = [self._line(one, here=one is here) for one in listed]
        more = len(rows) - len(listed)
        older = [row(button(f"{more} more", "fits.all", do=self._list_all))] if more else []
        problem = [paragraph(here.base.message, "bad")] if here is not None and here.base.message else []
        several = f"Cancel all {len(session.jobs)}" if len(session.jobs) > 1 else ""
        cancel = [row(button(several, "fits.cancel", "all", do=session.cancel, kind="danger"))] if several else []
        found = [heading("Fits", first=True), table(lines), *older, *problem, *cancel]
        self._rows.show(*(found if rows else []))
        self._draw_naming()
        detailed = here if _DETAILS in tab.state.folds else None
        self._details.show(*([] if detailed is None else details(detailed, result_of(session, detailed.run))))
        self._import.draw()
        self._deleted.draw()

    def _learn_errors(self) -> None:
        """Remember the errors of the fits on show."""
        if self._tab.session.edit_follower.lags:  # figures take all meshes, so not of fits that are about to change
            return
        for fit in (self._tab.shown.a, self._tab.shown.b):
            if fit is not None and fit.last and (figures := self._tab.data.metrics(fit)) is not None:
                self._errors[fit.run.id] = errors_in_words(figures)

    def _draw_naming(self) -> None:
        number = self._renamed
        if self._naming.visible is not (number is not None):
            self._naming.visible = number is not None
        rename = button("Rename", "fits.rename", f"{number}", do=lambda: self._rename(number or 0), enter=True)
        keep = button("Cancel", "fits.keep", do=self._stop_renaming)
        self._rename_buttons.show(*([] if number is None else [row(rename, keep)]))

    def _line(self, listed: Listed, *, here: bool) -> Html:
        tab, run, base = self._tab, listed.run, listed.base
        shown = [(_BADGES[side], tab.shown.fit(side)) for side in SLOTS if tab.state.comparing]
        badges = (badge for badge, fit in shown if fit is not None and fit.run.id in (run.id, base.id))
        title = joined(*badges, words(run.name, "strong"))
        name = opener(title, "fits.show", str(base.id), lambda: self._show(self._run(run.id)))
        below = tag("div", line_below(listed, self._errors.get(run.id, ""), tab.length), class_="tcfit-dim")
        kind = "here" if here else ""
        return line(joined(name, below), self._end(listed, here=here), numbers=(1,), kind=kind, press=name)

    def _end(self, listed: Listed, *, here: bool) -> Html:
        """What stands at the right of a row."""
        number, writable = listed.base.id, not self._tab.session.project.read_only
        made = []
        if listed.job is not None:
            cancel = partial(self._tab.session.worker.cancel, listed.job.number)
            made.append(button("Cancel", "fits.cancel", str(number), do=cancel, kind="mini"))
        elif listed.base.partial and writable:
            resume = lambda: self._gestures.fitting.resume(self._run(number))  # noqa: E731
            made.append(button("Continue", "fits.continue", str(number), do=resume, kind="mini", hint=_CONTINUE))
        if here:
            name = f"More about {listed.run.name}"
            made.append(menu_button("⋯", f"fits.menu {number}", self._menu(listed), name=name, kind="mini"))
        return joined(*made)

    def _menu(self, listed: Listed) -> list[Item | None]:
        tab, run = self._tab, listed.run
        there = "" if run in tab.session.fits.showable() else f"{run.name} has no result to show."
        off = "Open read-only." if tab.session.project.read_only else ""
        use = Item(label="Use its settings", do=partial(self._use_settings, run.id), obstacle=off)
        own = [use, action_item(self._gestures, "rerun_shape", "Fit the shape again")]
        return [
            Item(label="Compare with the one before", do=partial(self._compare, run, None), obstacle=there),
            Item(label="Compare with", more=self._others(run)),
            None,
            Item(label="Rename …", do=partial(self._begin_renaming, listed), obstacle=off),
            *(own if run.kind != "imported" else []),
            Item(label="Details", do=self._turn_details, checked=_DETAILS in tab.state.folds),
            None,
            Item(label="Import a result …", do=self._import.open, obstacle=off),
            Item(label="Delete", do=partial(self._delete, listed), obstacle=off),
        ]

    def _others(self, run: Run) -> list[Item | None]:
        """All that a fit can be compared with: its earlier passes, and other fits."""
        tab = self._tab
        others = [one for one in reversed(tab.session.fits.showable()) if one.id != run.id]
        names = {name: FitChoice(run=one.id) for name, one in by_name(others).items()}
        passes = {pass_of(run, n).capitalize(): FitChoice(run=run.id, phase=n) for n in passes_of(run)}
        return [Item(label=name, do=partial(self._compare, run, choice)) for name, choice in (passes | names).items()]


class DeletedFits:
    """Deleted fits, which can be restored until they are removed for good; shown only while there are any."""

    def __init__(self, tab: Tab) -> None:
        self._tab, self._asked = tab, False
        self._fold = Fold(tab, "fit.deleted")
        with self._fold:
            self._board = Board(tab)

    def _restore(self, run: Run) -> None:
        runs = self._tab.session.project.runs
        for one in (run, *(one for one in runs.all(deleted=True) if _corrects(one, run))):
            runs.undelete(one.id)
        self._tab.say(f"Restored: {run.name}")

    def _ask(self, asked: bool) -> None:
        self._asked = asked

    def _remove(self) -> None:
        self._asked, gone = False, len(self._tab.session.project.runs.purge())
        self._tab.say(f"Removed: {gone} fit{'s' if gone != 1 else ''}")

    def draw(self) -> None:
        """Send what changed."""
        fits, project = self._tab.session.fits, self._tab.session.project
        runs = self._tab.once("deleted runs", fits.version, lambda: tuple(project.runs.all(deleted=True)))
        shown = [run for run in reversed(runs) if not any(_corrects(run, other) for other in runs)]
        there = self._fold.draw(f"Deleted ({len(shown)})", on=bool(shown) and not project.read_only)
        self._board.show(*([table(map(self._line, shown)), *self._removal(len(shown))] if there else []))

    def _line(self, run: Run) -> Html:
        restore = partial(self._restore, run)
        return line(run.name, button("Restore", "deleted.restore", str(run.id), do=restore, kind="mini"), numbers=(1,))

    def _removal(self, count: int) -> list[Html]:
        """The removal for good, which asks once more."""
        if not self._asked:
            ask = partial(self._ask, True)
            return [row(button("Remove all permanently …", "deleted.ask", do=ask, kind="danger"))]
        what = f"{count} deleted fit{'s' if count != 1 else ''}"
        return [
            paragraph("Their results cannot be recovered.", "warn"),
            row(
                button(f"Remove {what}", "deleted.remove", do=self._remove, kind="danger"),
                button("Keep them", "deleted.keep", do=partial(self._ask, False)),
            ),
        ]


def _corrects(run: Run, other: Run) -> bool:
    return run.kind == "corrections" and run.parent == other.id


_OWN = "the result's body"
_UPLOAD = "An npz, a zip of SMPLify-X's results, or a learned system's file, from this browser's computer"
_SAID = (
    "SMPLify-X's output folder, an npz of SMPL-X or AMASS, a fit.npz, or a result of GVHMR, GEM, WHAM, PromptHMR, "
    "4D-Humans or SAM 3D Body, as a fit to compare. It must match this clip's frames."
)


class ImportedFits:
    """Imports another program's result into the project."""

    def __init__(self, tab: Tab) -> None:
        self._tab = tab
        self._fold = Fold(tab, "fit.import")
        with self._fold:
            Board(tab).show(paragraph(_SAID, "dim"))
            self._file = FileInput(
                tab,
                "import.path",
                self._take,
                path=TextRow("Path", "Folder or file on the computer where tcfit runs"),
                more=(
                    TextRow("First frame", "Video frame number of the result's first frame; empty: as stored in it"),
                    TextRow("Posed on", "Another body keeps the joint angles but drops the shape", (_OWN, *KINDS)),
                ),
                button="Import",
                missing="Type the path of a result first; expected a folder or a file of one of the programs above.",
                upload=TextRow("Upload a file", _UPLOAD),
            )

    def open(self) -> None:
        """Show it, and let the user type the path."""
        self._fold.turn(on=True)
        self._tab.show_panel("Fit", "Path")

    def _take(self, file: Path | viser.UploadedFile) -> None:
        session, body = self._tab.session, self._file["Posed on"]
        choices = ImportChoices(
            first_frame=frame_number("First frame", self._file["First frame"]),
            body_model=None if body == _OWN else body,
        )

        def work(report: Step) -> Run:
            if isinstance(file, Path):
                return session.import_run(file, choices, report)
            return session.import_upload(file.name, file.content, choices, report)

        self._file.read("Importing a result", work, self._done)

    def _done(self, run: Run) -> None:
        self._fold.turn(on=False)
        self._tab.set(a=FitChoice(run=run.id))
        self._tab.say(f"Imported: {run.name}; Compare (2) shows it")

    def draw(self) -> None:
        """Send what changed."""
        writable = not self._tab.session.project.read_only
        self._fold.draw("Import a result", on=writable and (self._fold.open or not self._tab.session.fits.runs))
        self._file.draw()
