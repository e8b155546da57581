"""The panel Export: files of the project and its fits, as downloads of the browser."""

from typing import TYPE_CHECKING, ClassVar

import viser

import tcfit_app.panels.markup as markup
from fitting_core.errors import InputError
from tcfit_app.exporting import Exporting
from tcfit_app.exports import EXPORTS, ExportedFit, ExportSource
from tcfit_app.fits import Shown as ShownFit
from tcfit_app.panels.fields import Shown, on_press

if TYPE_CHECKING:
    from tcfit_app.page import Page


class ExportPanel:
    """See `Panel`."""

    title: ClassVar[str] = "Export"
    icon: ClassVar[viser.IconName] = viser.Icon.DOWNLOAD

    def __init__(self, page: "Page") -> None:
        self._page, gui = page, page.client.gui
        self.running: Exporting | None = None
        """The export that began last."""
        self._what = Shown(gui.add_html(""))
        self._buttons: dict[str, Shown] = {}
        for name, export in EXPORTS.items():
            button = gui.add_button(export.title, hint=export.hint, icon=viser.Icon.DOWNLOAD, color="gray")
            on_press(page, button, lambda name=name: self._begin(name))
            self._buttons[name] = Shown(button)
        self._said = Shown(gui.add_html("", visible=False))
        self._bar = Shown(gui.add_progress_bar(0.0, visible=False))
        self._cancel = Shown(gui.add_button("Cancel", visible=False, color="red", icon=viser.Icon.PLAYER_STOP))
        on_press(page, self._cancel.handle, self._stop)

    def _begin(self, name: str) -> None:
        if self.running is not None and self.running.state == "running":
            raise InputError(f"{self.running.name} is still being made: wait for it, or cancel it.")
        page, export = self._page, EXPORTS[name]
        a, b = page.fit(page.state.a), page.fit(page.state.b)
        fits = (self._exported(a), self._exported(b)) if export.needs_fit else (None, None)
        source = ExportSource(clip=page.session.project.clip, a=fits[0], b=fits[1])
        if export.needs_fit:
            source.fit  # noqa: B018 - told before anything begins
        filename = source.clip.name + export.suffix
        self.running = Exporting(
            export, source, lambda content: page.client.send_file_download(filename, content, save_immediately=True)
        )

    def _exported(self, shown: ShownFit | None) -> ExportedFit | None:
        if shown is None:
            return None
        page = self._page
        return ExportedFit(shown=shown, fit=page.session.fits.fit(shown.run), meshes=page.desk.meshes(shown))

    def _stop(self) -> None:
        if self.running is not None:
            self.running.cancel()

    def draw(self) -> None:
        """See `Panel.draw`."""
        self._draw_what()
        going = self.running
        if going is None or not self._page.changes.of(
            "export", going, going.state, going.stopping, round(100 * going.share)
        ):
            return
        busy = going.state == "running"
        self._said.show(content=markup.panel(_said(going)), visible=True)
        self._bar.show(value=round(100 * going.share, 1), visible=busy)
        self._cancel.show(visible=busy and not going.stopping)

    def _draw_what(self) -> None:
        page = self._page
        a, b = page.fit(page.state.a), page.fit(page.state.b)
        titles = tuple(None if fit is None else fit.title for fit in (a, b))
        if not page.changes.of("exported", titles):
            return
        for name, button in self._buttons.items():
            button.show(disabled=EXPORTS[name].needs_fit and b is None)
        fits = (f"A: {titles[0]}", f"B: {titles[1]}") if b is not None else ("There is no fit yet: see the panel Fit.",)
        lines = ["Files are sent to this browser's downloads.", *fits]
        self._what.show(content=markup.panel("<br>".join(map(markup.muted, lines))))


def _said(going: Exporting) -> str:
    name = markup.bold(going.name)
    if going.state == "failed":
        return f"{name} could not be made{markup.problem(going.reason)}"
    if going.state == "finished":
        done = markup.colored("sent to the downloads", markup.GOOD)
        return f"{name}: {done} ({_size(going.size)})"
    if going.state == "cancelled":
        return f"{name}: cancelled"
    return f"{name} is being stopped ..." if going.stopping else f"{name} is being made ..."


def _size(count: int) -> str:
    return f"{count / 1e6:.1f} MB" if count >= 1e6 else f"{max(1, round(count / 1e3))} kB"
