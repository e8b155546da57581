"""The panel Runs: every fit of the project, what it was made with, and what can be done with it."""

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import viser

import tcfit_app.panels.markup as markup
from fitting_core.config_file import as_toml
from fitting_core.errors import InputError
from tcfit_app.fits import FitChoice
from tcfit_app.panels.fields import Field, Shown, on_choice, on_press
from tcfit_app.panels.fit_settings import nearest_preset
from tcfit_app.panels.run_texts import Listed, details, result_of, row
from tcfit_app.storage.runs import Run

if TYPE_CHECKING:
    from tcfit_app.page import Page

LISTED = 30
"""Runs in the table, the newest; the choice has them all."""
_NONE = "no runs yet"
_AS_A, _AS_B = "Show as A", "Show as B"
_RENAME, _DELETE = "Rename", "Delete"


class RunsPanel:
    """See `Panel`."""

    title: ClassVar[str] = "Runs"
    icon: ClassVar[viser.IconName] = viser.Icon.LIST_DETAILS

    def __init__(self, page: "Page") -> None:
        self._page = page
        self._chosen: int | None = None
        """The run whose details are shown; None: the newest."""
        gui = page.client.gui
        self._choice = Field(page, gui.add_dropdown("Run", (_NONE,)), self._choose)
        self._options = (_NONE,)
        self._show = gui.add_button_group("", (_AS_A, _AS_B))
        on_choice(page, self._show, self._show_as)
        self._restore = self._button("Use its settings for the next fit", self._use_settings, icon=viser.Icon.SETTINGS)
        self._cancel = self._button("Cancel", self._cancel_chosen, color="red", icon=viser.Icon.PLAYER_STOP)
        with gui.add_folder("All runs"):
            self._table = Shown(gui.add_html(""))
        with gui.add_folder("This run"):
            self._name = gui.add_text("Name", "", hint="Enter another name, then Rename")
            self._change = Shown(gui.add_button_group("", (_RENAME, _DELETE)))
            on_choice(page, self._change.handle, self._change_chosen)
            self._details = Shown(gui.add_html(""))
        with gui.add_folder("All its settings", expand_by_default=False):
            self._toml = Shown(gui.add_html(""))
        self._deleted = _DeletedRuns(page)

    def _button(
        self,
        label: str,
        pressed: Callable[[], None],
        *,
        color: Literal["gray", "red"] = "gray",
        icon: viser.IconName | None = None,
    ) -> Shown:
        handle = self._page.client.gui.add_button(label, color=color, icon=icon)
        on_press(self._page, handle, pressed)
        return Shown(handle)

    # --- what is done ---

    @property
    def _run(self) -> Run:
        runs = self._page.session.fits.runs
        if not runs:
            raise InputError("There is no run yet: fit everything first.")
        return next((run for run in runs if run.id == self._chosen), runs[-1])

    def _choose(self, option: str) -> None:
        runs = self._page.session.fits.runs
        self._chosen = next((run.id for run in runs if option == _option(run)), None)

    def _show_as(self, which: str) -> None:
        run = self._run
        if run not in self._page.session.fits.showable():
            raise InputError(f"{run.name} has no result that could be shown.")
        self._page.set(**{"a" if which == _AS_A else "b": FitChoice(run=run.id)})

    def _change_chosen(self, how: str) -> None:
        run, session = self._run, self._page.session
        self._page.refuse_read_only()
        if how == _RENAME:
            session.rename(run.id, self._name.value)
            self._page.say("Renamed")
            return
        session.delete(run.id)
        self._chosen = None
        self._page.say(f"Deleted: {run.name}; it can be restored below")

    def _cancel_chosen(self) -> None:
        self._page.session.cancel(self._run.id)

    def _use_settings(self) -> None:
        run, page = self._run, self._page
        fit, clip = result_of(page.session, run), page.session.project.clip.camera
        focal = fit.camera.focal[0] if fit is not None and fit.camera.focal != clip.focal else None
        settings = replace(
            page.state.settings,
            config=run.config,
            preset=nearest_preset(run.config),
            kind=run.body.kind,
            gender=run.body.gender,
            focal=focal,
            problems=(),
        )
        page.set(settings=settings)
        page.say(f"The next fit has the settings of {run.name}")

    # --- drawing ---

    def draw(self) -> None:
        """See `Panel.draw`."""
        self._deleted.draw()
        page, session = self._page, self._page.session
        shown = tuple(fit.run.id if fit else None for fit in (page.fit(page.state.a), page.fit(page.state.b)))
        shares = tuple(
            (job.run, job.started, round(100 * job.progress.share) if job.progress else 0)
            for job in session.jobs.values()
        )
        if not page.changes.of("runs", session.fits.changes, session.edits, shown, shares, self._chosen):
            return
        runs = session.fits.runs
        self._draw_choice(runs)
        jobs = {job.run: job for job in session.jobs.values()}
        listed = [
            Listed(
                run=run,
                shown_as=tuple(name for name, there in zip("AB", shown, strict=True) if there == run.id),
                edits=session.edits_since(run),
                job=jobs.get(run.id),
                first_frame=page.first_frame,
            )
            for run in reversed(runs)
        ]
        self._draw_table(listed)
        self._draw_chosen(listed)

    def _draw_choice(self, runs: tuple[Run, ...]) -> None:
        options = tuple(_option(run) for run in reversed(runs)) or (_NONE,)
        if options != self._options:
            self._options = options
            self._choice.handle.options = options
        self._choice.show(_option(self._run) if runs else _NONE)

    def _draw_table(self, listed: list[Listed]) -> None:
        rows = [row(one) for one in listed[:LISTED]]
        older = f"<div>{markup.muted(f'and {len(listed) - LISTED} older')}</div>" if len(listed) > LISTED else ""
        nothing = markup.muted("Nothing was fitted yet: see the panel Fit.")
        self._table.show(content=markup.panel(markup.table(rows, numbers=1) + older if rows else nothing))

    def _draw_chosen(self, listed: list[Listed]) -> None:
        session = self._page.session
        chosen = next((one for one in listed if one.run.id == self._run.id), None) if listed else None
        self._change.show(visible=chosen is not None)
        self._cancel.show(visible=chosen is not None and chosen.job is not None)
        self._restore.show(disabled=chosen is None)
        if chosen is None:
            self._details.show(content="")
            self._toml.show(content="")
            return
        run = chosen.run
        if self._page.changes.of("run name", run.id, run.name):
            self._name.value = run.name
        self._details.show(content=markup.panel(details(chosen, session, result_of(session, run))))
        toml = as_toml(run.config, preset_name=nearest_preset(run.config))
        self._toml.show(content=markup.panel(markup.preformatted(toml)))


class _DeletedRuns:
    """Runs that can be brought back, until they are removed for good."""

    def __init__(self, page: "Page") -> None:
        self._page, gui = page, page.client.gui
        self._runs: tuple[Run, ...] = ()
        self._folder = Shown(gui.add_folder("Deleted runs", expand_by_default=False, visible=False))
        with self._folder.handle:
            self._choice: Any = gui.add_dropdown("Run", (_NONE,))
            on_press(page, gui.add_button("Restore", color="gray", icon=viser.Icon.ARROW_BACK_UP), self._restore)
            remove = gui.add_button("Remove for good ...", color="red", icon=viser.Icon.TRASH_X)
            on_press(page, remove, self._ask)

    def _restore(self) -> None:
        run = next((run for run in self._runs if _option(run) == self._choice.value), None)
        if run is not None:
            self._page.session.restore(run.id)
            self._page.say(f"Restored: {run.name}")

    def _ask(self) -> None:
        """Remove them if the user confirms it in a window."""
        gui, count = self._page.client.gui, len(self._runs)
        what = f"{count} deleted run{'s' if count != 1 else ''}"
        modal = gui.add_modal(f"Remove {what} for good?")
        with modal:
            names = "".join(f"<div>{markup.text(run.name)}</div>" for run in self._runs)
            gui.add_html(markup.panel(f"{names}<br>Their results cannot be brought back."))
            remove = gui.add_button(f"Remove {what}", color="red", icon=viser.Icon.TRASH_X)
            keep = gui.add_button("Keep them", color="gray")

        def purge() -> None:
            modal.close()
            self._page.say(f"Removed: {self._page.session.purge()} runs")

        on_press(self._page, remove, purge)
        on_press(self._page, keep, modal.close)

    def draw(self) -> None:
        """Send what changed."""
        session = self._page.session
        if not self._page.changes.of("deleted runs", session.fits.changes):
            return
        self._runs = tuple(session.project.runs.all(deleted=True))
        self._folder.show(visible=bool(self._runs), label=f"Deleted runs ({len(self._runs)})")
        options = tuple(_option(run) for run in reversed(self._runs)) or (_NONE,)
        if options != tuple(self._choice.options):
            self._choice.options = options


def _option(run: Run) -> str:
    """A run in a choice; names may be alike, numbers are not."""
    return f"{run.id} · {run.name}"
