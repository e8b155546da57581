"""The Runs panel: every fit of the project, how it was made, and what can be done with it."""

from dataclasses import replace
from functools import partial
from typing import Any, ClassVar

import viser

from fitting_core.config.toml import as_toml
from fitting_core.errors import InputError
from tcfit_app.fitting.fits import FitChoice
from tcfit_app.project.storage.run_record import Run
from tcfit_app.review.gestures.actions import Gestures
from tcfit_app.review.panels.elements.field import Dropdown, Field, for_writers
from tcfit_app.review.panels.elements.html import Board, button, heading, paragraph, row, table, tag
from tcfit_app.review.panels.fit.fit_settings import nearest_preset
from tcfit_app.review.panels.runs.import_run import ImportRun
from tcfit_app.review.panels.runs.parents import parent_of, show_beside_parent
from tcfit_app.review.panels.runs.run_texts import Listed, details, result_of, run_line
from tcfit_app.review.tab.buttons import one_of
from tcfit_app.review.tab.on_show import SLOTS
from tcfit_app.review.tab.tab import Tab

LISTED = 30
"""The newest runs listed; the dropdown has all."""
_NONE = "no runs yet"
_REFINE = "Fit everything, starting from this run, with the settings of the panel Fit"
_RENAME = "Rename to the text in the Name field (or press Enter there)"


class RunsPanel:
    """See `Panel`."""

    title: ClassVar[str] = "Runs"
    icon: ClassVar[viser.IconName] = viser.Icon.LIST_DETAILS

    def __init__(self, gestures: Gestures) -> None:
        self._gestures, self._tab = gestures, gestures.tab
        tab = gestures.tab
        self._chosen: int | None = None
        """The run whose details are shown; None: the newest."""
        self._drawn: int | None = None
        """The run the user sees there now."""
        gui = tab.client.gui
        self._table = Board(tab)
        self._head = Board(tab)
        self._chooser = gui.add_dropdown("Run", (_NONE,))
        self._choice = Dropdown(tab, self._chooser, self._choose)
        self._name = gui.add_text("Name", "", hint="Type another name, then Enter or Rename")
        for_writers(tab, self._name)
        self._naming = Field(tab, self._name, lambda _: setattr(self, "_chosen", self._drawn))
        self._buttons, self._details = Board(tab), Board(tab)
        self._settings = gui.add_folder("All its settings", expand_by_default=False)
        with self._settings:
            self._toml = Board(tab)
        self._import = ImportRun(tab, lambda run: setattr(self, "_chosen", run.id))
        self._deleted = DeletedRuns(tab)
        self._listen()

    def _listen(self) -> None:
        tab = self._tab
        tab.buttons.on("runs.choose", lambda number: setattr(self, "_chosen", number), int)
        tab.buttons.on("runs.show", self._show_as, _side_and_run)
        tab.buttons.on("runs.parent", lambda number: show_beside_parent(tab, self._pressed(number)), int)
        tab.buttons.on("runs.settings", lambda number: self._use_settings(self._pressed(number)), int)
        tab.buttons.on("runs.refine", lambda number: self._gestures.fitting.refine(self._pressed(number)), int)
        tab.buttons.on("runs.cancel", tab.session.cancel, int)
        tab.buttons.on("runs.rename", lambda number: self._rename(self._pressed(number)), int)
        tab.buttons.on("runs.delete", lambda number: self._delete(self._pressed(number)), int)

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

    def _choose(self, name: str) -> None:
        runs = self._tab.session.fits.runs
        self._chosen = next((run.id for run in runs if name == run.option), None)

    def _show_as(self, what: tuple[str, int]) -> None:
        side, number = what
        run = self._pressed(number)
        if run not in self._tab.session.fits.showable():
            raise InputError(f"{run.name} has no result to show.")
        self._tab.set(**{side: FitChoice(run=run.id)})

    def _rename(self, run: Run) -> None:
        self._tab.refuse_read_only()
        self._tab.session.rename(run.id, self._name.value)
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
        self._draw_choice(runs)
        for handle in (self._chooser, self._name):
            handle.visible = bool(runs)
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

    def _draw_choice(self, runs: tuple[Run, ...]) -> None:
        options = tuple(run.option for run in reversed(runs)) or (_NONE,)
        self._choice.offer(options, self._run.option if runs else _NONE)

    def _draw_table(self, listed: list[Listed]) -> None:
        if not listed:
            self._table.show(heading("All runs", first=True), paragraph("No fits yet: see the panel Fit.", "dim"))
            return
        first, here = self._tab.first_frame, self._run
        rows = [
            run_line(one, first_frame=first, frames=self._tab.length, here=one.run.id == here.id)
            for one in listed[:LISTED]
        ]
        more = len(listed) - LISTED
        older = [paragraph(f"and {more} older", "dim")] if more > 0 else []
        self._table.show(heading("All runs", "click for details", first=True), table(rows), *older)

    def _draw_chosen(self, listed: list[Listed]) -> None:
        session = self._tab.session
        chosen = next((one for one in listed if one.run.id == self._run.id), None) if listed else None
        if chosen is None:
            for board in (self._buttons, self._details, self._toml):
                board.show()
            self._settings.visible = False
            return
        run = chosen.run
        self._drawn = run.id
        if not self._naming.waiting:  # otherwise what is being typed would be lost
            self._tab.once("run name", (run.id, run.name), lambda: self._naming.show(run.name))
        self._draw_buttons(chosen)
        self._details.show(*details(chosen, session, result_of(session, run)))
        own = run.kind != "imported"
        self._settings.visible = own
        toml = self._tab.once("toml", run.id, lambda: as_toml(run.config, preset_name=nearest_preset(run.config)))
        self._toml.show(*([tag("pre", toml)] if own else []))

    def _draw_buttons(self, chosen: Listed) -> None:
        off, number = self._tab.session.project.read_only, str(chosen.run.id)
        there = chosen.run in self._tab.session.fits.showable()
        parent = parent_of(self._tab, chosen.run)
        show = partial(button, command="runs.show", disabled=not there)
        cancel = [row(button("Cancel", "runs.cancel", number, kind="danger"))] if chosen.job is not None else []
        self._buttons.show(
            row(
                button("Rename", "runs.rename", number, disabled=off, hint=_RENAME, enter=True),
                button("Delete", "runs.delete", number, disabled=off, hint="It can be restored", kind="danger"),
            ),
            row(
                *(
                    show(f"Show as {side.upper()}", value=f"{side} {number}", pressed=side.upper() in chosen.shown_as)
                    for side in SLOTS
                )
            ),
            row(
                button(
                    "Compare with its parent",
                    "runs.parent",
                    number,
                    disabled=not there or parent is None,
                    hint=f"A: {parent.name}" if parent else "It did not start from another run",
                )
            ),
            row(button("Refine", "runs.refine", number, disabled=off or not chosen.run.stored, hint=_REFINE)),
            *(
                []
                if chosen.run.kind == "imported"
                else [row(button("Use its settings for the next fit", "runs.settings", number, disabled=off))]
            ),
            *cancel,
        )


def _side_and_run(value: str) -> tuple[str, int]:
    """Where to show which run: "a 5"."""
    side, number = value.split(" ")
    return one_of(SLOTS)(side), int(number)


_BUTTONS = row(button("Restore", "deleted.restore"), button("Remove all permanently …", "deleted.ask", kind="danger"))


class DeletedRuns:
    """Deleted runs, which can be restored until they are removed for good; shown only while there are any."""

    def __init__(self, tab: Tab) -> None:
        self._tab, gui = tab, tab.client.gui
        self._runs: tuple[Run, ...] = ()
        self._window: Any = None
        """The confirmation window, if it was ever opened."""
        self._question: Board | None = None
        """The runs it shows."""
        self._folder = gui.add_folder("Deleted runs", visible=False)
        with self._folder:
            self._choice: Any = gui.add_dropdown("Deleted", ("",))
            self._buttons = Board(tab)
        tab.buttons.on("deleted.restore", lambda _: self._restore())
        tab.buttons.on("deleted.ask", lambda _: self._ask())
        tab.buttons.on("deleted.remove", lambda _: self._remove())
        tab.buttons.on("deleted.keep", lambda _: self._close())

    def _restore(self) -> None:
        run = next((run for run in self._runs if run.option == self._choice.value), None)
        if run is not None:
            self._tab.session.restore(run.id)
            self._tab.say(f"Restored: {run.name}")

    def _ask(self) -> None:
        """Remove them once the user confirms in a window."""
        what = f"{len(self._runs)} deleted run{'s' if len(self._runs) != 1 else ''}"
        self._close()
        self._window = self._tab.client.gui.add_modal(f"Remove {what} permanently?")
        with self._window:
            self._question = Board(self._tab)
        self._question.show(
            *(paragraph(run.name) for run in self._runs),
            paragraph("Their results cannot be recovered.", "warn"),
            row(button(f"Remove {what}", "deleted.remove", kind="danger")),
            button("Keep them", "deleted.keep", kind="close"),
        )

    def _remove(self) -> None:
        self._close()
        gone = self._tab.session.purge()
        self._tab.say(f"Removed: {gone} run{'s' if gone != 1 else ''}")

    def _close(self) -> None:
        if self._question is not None and not self._window.closed:
            self._question.show()
            self._window.close()

    def draw(self) -> None:
        """Send what changed."""
        session = self._tab.session
        self._runs = self._tab.once(
            "deleted runs", session.fits.version, lambda: tuple(session.project.runs.all(deleted=True))
        )
        self._folder.visible = bool(self._runs)
        self._buttons.show(*([_BUTTONS] if self._runs else []))
        options = tuple(run.option for run in reversed(self._runs)) or ("",)
        if options != self._choice.options:  # viser sends them on every assignment
            self._choice.options = options
