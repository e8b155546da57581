"""The Runs panel: every fit of the project, how it was made, and what can be done with it."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import viser

from fitting_core.body.files.forms import KINDS
from fitting_core.errors import InputError
from tcfit_app.fitting.fits import FitChoice
from tcfit_app.imports.results import ImportChoices
from tcfit_app.project.storage.run_record import Run
from tcfit_app.review.gestures.actions import Gestures
from tcfit_app.review.panels.elements.field import Field, for_writers, frame_number
from tcfit_app.review.panels.elements.file_input import FileInput, TextRow
from tcfit_app.review.panels.elements.html import Board, Html, button, heading, line, paragraph, row, table
from tcfit_app.review.panels.fit.fit_settings import nearest_preset
from tcfit_app.review.panels.runs.run_texts import Listed, remarks, result_of, run_line
from tcfit_app.review.session.tasks import Step
from tcfit_app.review.tab.on_show import SLOTS, Slot
from tcfit_app.review.tab.tab import Tab

LISTED = 30
"""The newest runs listed; the older ones on request."""
_CONTINUE = "Fit everything with this run's settings; the frames fitted so far are not fitted again"
_RENAME = "Rename to the text in the Name field (or press Enter there)"


def parent_of(tab: Tab, run: Run) -> Run | None:
    """The run that this one started from, if it can be shown."""
    return next((one for one in tab.session.fits.showable() if one.id == run.parent), None)


def show_beside_parent(tab: Tab, run: Run) -> None:
    """Show it in A | B, with its parent as A. Raises InputError if it has none."""
    parent = parent_of(tab, run)
    if parent is None:
        raise InputError(
            f"{run.name} has no parent to show: it did not start from another run, or that run was deleted."
        )
    tab.set(mode="ab", a=FitChoice(run=parent.id), b=FitChoice(run=run.id))


class RunsPanel:
    """See `Panel`."""

    title: ClassVar[str] = "Runs"
    icon: ClassVar[viser.IconName] = viser.Icon.LIST_DETAILS

    def __init__(self, gestures: Gestures) -> None:
        self._gestures, self._tab = gestures, gestures.tab
        tab, gui = gestures.tab, gestures.tab.client.gui
        self._chosen: int | None = None
        """The run whose details are shown; None: the newest."""
        self._drawn: int | None = None
        """The run the user sees there now."""
        self._all = False
        """All runs are listed."""
        self._table, self._head = Board(tab), Board(tab)
        self._name = gui.add_text("Name", "", hint="Type another name, then Enter or Rename")
        for_writers(tab, self._name)
        self._naming = Field(tab, self._name, lambda _: self._choose(self._drawn))
        self._buttons, self._details = Board(tab), Board(tab)
        self._import = ImportRun(tab, lambda run: self._choose(run.id))
        self._deleted = DeletedRuns(tab)

    # --- what is done ---

    @property
    def _run(self) -> Run:
        runs = self._tab.session.fits.runs
        if not runs:
            raise InputError("There is no run yet: fit everything first.")
        return next((run for run in runs if run.id == self._chosen), runs[-1])

    def _pressed(self, number: int) -> Run:
        """The run that a button was for, even if a newer one has taken its place since. It stays on show."""
        run = self._tab.session.fits.run(number)
        if run is None:
            raise InputError("This run has been deleted; it can be restored below.")
        self._chosen = run.id
        return run

    def _choose(self, number: int | None) -> None:
        self._chosen = number

    def _list_all(self) -> None:
        self._all = True

    def _show_as(self, side: Slot, run: Run) -> None:
        if run not in self._tab.session.fits.showable():
            raise InputError(f"{run.name} has no result to show.")
        self._tab.set(**{side: FitChoice(run=run.id)})

    def _rename(self, run: Run) -> None:
        self._tab.refuse_read_only()
        self._tab.session.project.runs.rename(run.id, self._name.value)
        self._tab.say("Renamed")

    def _delete(self, run: Run) -> None:
        self._tab.refuse_read_only()
        self._tab.session.delete(run.id)
        self._chosen = None
        self._tab.say(f"Deleted: {run.name}; it can be restored below")

    def _use_settings(self, run: Run) -> None:
        tab = self._tab
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

    # --- drawing ---

    def draw(self) -> None:
        """See `Panel.draw`."""
        self._import.draw()
        self._deleted.draw()
        tab, session = self._tab, self._tab.session
        shown = tuple(fit.run.id if fit else None for fit in (tab.shown.a, tab.shown.b))
        runs = session.fits.runs
        self._name.visible = bool(runs)
        self._head.show(*([heading("This run")] if runs else []))
        jobs = {job.run: job for job in session.jobs.values()}
        listed = [
            Listed(
                run=run,
                shown_as=tuple(name for name, there in zip("AB", shown, strict=True) if there == run.id),
                edits=session.edits_since(run),
                job=jobs.get(run.id),
                unwritten=run.id in session.fits.unwritten,
            )
            for run in reversed(runs)
        ]
        self._draw_table(listed)
        self._draw_chosen(listed)

    def _draw_table(self, listed: list[Listed]) -> None:
        if not listed:
            self._table.show(heading("All runs", first=True), paragraph("No fits yet: see the panel Fit.", "dim"))
            return
        first, here = self._tab.first_frame, self._run
        rows = [
            run_line(
                one,
                first_frame=first,
                frames=self._tab.length,
                here=one.run.id == here.id,
                choose=partial(self._choose, one.run.id),
            )
            for one in (listed if self._all else listed[:LISTED])
        ]
        more = len(listed) - len(rows)
        older = [row(button(f"List {more} older", "runs.all", do=self._list_all))] if more > 0 else []
        self._table.show(heading("All runs", "click for details", first=True), table(rows), *older)

    def _draw_chosen(self, listed: list[Listed]) -> None:
        session = self._tab.session
        chosen = next((one for one in listed if one.run.id == self._run.id), None) if listed else None
        if chosen is None:
            self._buttons.show()
            self._details.show()
            return
        run = chosen.run
        self._drawn = run.id
        if not self._naming.waiting:  # otherwise what is being typed would be lost
            self._tab.once("run name", (run.id, run.name), lambda: self._naming.show(run.name))
        self._draw_buttons(chosen)
        self._details.show(*remarks(run, result_of(session, run)))

    def _draw_buttons(self, chosen: Listed) -> None:
        tab, run, off = self._tab, chosen.run, self._tab.session.project.read_only
        there, parent = run in tab.session.fits.showable(), parent_of(tab, run)

        def of_run(label: str, command: str, do: Callable[[Run], object], **looks: Any) -> Html:
            return button(label, command, str(run.id), do=lambda: do(self._pressed(run.id)), **looks)

        shows = (
            button(
                f"Show as {side.upper()}",
                "runs.show",
                f"{side} {run.id}",
                do=lambda side=side: self._show_as(side, self._pressed(run.id)),
                pressed=side.upper() in chosen.shown_as,
                disabled=not there,
            )
            for side in SLOTS
        )
        beside = of_run(
            "Compare with its parent",
            "runs.parent",
            partial(show_beside_parent, tab),
            disabled=not there or parent is None,
            hint=f"A: {parent.name}" if parent else "It did not start from another run",
        )
        use = of_run("Use its settings for the next fit", "runs.settings", self._use_settings, disabled=off)
        cancel = of_run("Cancel", "runs.cancel", lambda run: tab.session.cancel(run.id), kind="danger")
        resume = of_run("Continue", "runs.continue", self._gestures.fitting.resume, disabled=off, hint=_CONTINUE)
        self._buttons.show(
            *([row(resume)] if run.partial else []),
            row(
                of_run("Rename", "runs.rename", self._rename, disabled=off, hint=_RENAME, enter=True),
                of_run("Delete", "runs.delete", self._delete, disabled=off, hint="It can be restored", kind="danger"),
            ),
            row(*shows),
            row(beside),
            *([] if run.kind == "imported" else [row(use)]),
            *([] if chosen.job is None else [row(cancel)]),
        )


class DeletedRuns:
    """Deleted runs, which can be restored until they are removed for good; shown only while there are any."""

    def __init__(self, tab: Tab) -> None:
        self._tab, self._asked = tab, False
        self._folder = tab.client.gui.add_folder("Deleted runs", visible=False)
        with self._folder:
            self._board = Board(tab)

    def _restore(self, run: Run) -> None:
        self._tab.session.project.runs.undelete(run.id)
        self._tab.say(f"Restored: {run.name}")

    def _ask(self, asked: bool) -> None:
        self._asked = asked

    def _remove(self) -> None:
        self._asked, gone = False, len(self._tab.session.project.runs.purge())
        self._tab.say(f"Removed: {gone} run{'s' if gone != 1 else ''}")

    def draw(self) -> None:
        """Send what changed."""
        fits, project = self._tab.session.fits, self._tab.session.project
        runs = self._tab.once("deleted runs", fits.version, lambda: tuple(project.runs.all(deleted=True)))
        self._folder.visible = bool(runs)
        self._board.show(*([table(map(self._line, reversed(runs))), *self._removal(len(runs))] if runs else []))

    def _line(self, run: Run) -> Html:
        restore = partial(self._restore, run)
        return line(run.name, button("Restore", "deleted.restore", str(run.id), do=restore, kind="mini"), numbers=(1,))

    def _removal(self, count: int) -> list[Html]:
        """The removal for good, which asks once more."""
        if not self._asked:
            ask = partial(self._ask, True)
            return [row(button("Remove all permanently …", "deleted.ask", do=ask, kind="danger"))]
        what = f"{count} deleted run{'s' if count != 1 else ''}"
        return [
            paragraph("Their results cannot be recovered.", "warn"),
            row(
                button(f"Remove {what}", "deleted.remove", do=self._remove, kind="danger"),
                button("Keep them", "deleted.keep", do=partial(self._ask, False)),
            ),
        ]


_OWN = "the result's body"
_UPLOAD = "An npz, a zip of SMPLify-X's results, or a learned system's file, from this browser's computer"
_SAID = (
    "SMPLify-X's output folder, an npz of SMPL-X or AMASS, a fit.npz, or a result of GVHMR, GEM, WHAM, PromptHMR, "
    "4D-Humans or SAM 3D Body, as a run to compare. It must match this clip's frames."
)


class ImportRun:
    """Imports another program's result into the project; `imported` receives the new run."""

    def __init__(self, tab: Tab, imported: Callable[[Run], None]) -> None:
        self._tab, self._imported = tab, imported
        with tab.client.gui.add_folder("Import a result", expand_by_default=False):
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
                main=True,
            )

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
        self._imported(run)
        self._tab.say(f"Imported: {run.name}; show it as A or B")

    def draw(self) -> None:
        """Send what changed."""
        self._file.draw()
