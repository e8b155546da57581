"""The panel Export: files of the project and its fits, as downloads of the browser."""

from typing import TYPE_CHECKING, ClassVar

import viser

from fitting_core.errors import InputError
from tcfit_app.exporting import Exporting
from tcfit_app.exports import EXPORTS, ExportedFit, ExportSource
from tcfit_app.fits import Shown
from tcfit_app.panels.html import Board, Html, button, dot, heading, joined, paragraph, progress_bar, row, text, words
from tcfit_app.view.layers import RUN_COLORS, css

if TYPE_CHECKING:
    from tcfit_app.page import Page


class ExportPanel:
    """See `Panel`."""

    title: ClassVar[str] = "Export"
    icon: ClassVar[viser.IconName] = viser.Icon.DOWNLOAD

    def __init__(self, page: "Page") -> None:
        self._page = page
        self.running: Exporting | None = None
        """The export that began last."""
        self._files, self._said = Board(page), Board(page)
        page.on_press("export.begin", self._begin)
        page.on_press("export.cancel", lambda _: self._stop())

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

    def _exported(self, shown: Shown | None) -> ExportedFit | None:
        if shown is None:
            return None
        page = self._page
        return ExportedFit(shown=shown, fit=page.session.fits.fit(shown.run), meshes=page.desk.meshes(shown))

    def _stop(self) -> None:
        if self.running is not None:
            self.running.cancel()

    def draw(self) -> None:
        """See `Panel.draw`."""
        page = self._page
        fits = (page.fit(page.state.a), page.fit(page.state.b))
        if page.changes.of("exported", tuple(None if fit is None else fit.title for fit in fits)):
            self._files.show(*_files(fits))
        going = self.running
        if going is not None and page.changes.of(
            "export", going, going.state, going.stopping, round(100 * going.share)
        ):
            self._said.show(heading("Last file"), *_said(going))


def _files(fits: tuple[Shown | None, Shown | None]) -> list[Html]:
    """What can be exported, and of which fits."""
    named = zip("AB", RUN_COLORS, fits, strict=True)
    titles = [joined(dot(css(color)), text(f"{name}: {fit.title}")) for name, color, fit in named if fit is not None]
    buttons = [
        row(button(export.title, "export.begin", name, disabled=export.needs_fit and fits[1] is None, hint=export.hint))
        for name, export in EXPORTS.items()
    ]
    return [
        heading("Files", "to this browser's downloads", first=True),
        *map(paragraph, titles or [words("There is no fit yet: see the panel Fit.", "dim")]),
        *buttons,
    ]


def _said(going: Exporting) -> list[Html]:
    """How far an export is, or how it ended."""
    name = words(going.name, "strong")
    if going.state == "failed":
        return [paragraph(joined(name, text(" could not be made"))), paragraph(going.reason, "bad")]
    if going.state == "finished":
        sent = words("sent to the downloads", "good")
        return [paragraph(joined(name, text(": "), sent, text(f" ({_size(going.size)})")))]
    if going.state == "cancelled":
        return [paragraph(joined(name, text(": cancelled")))]
    doing = " is being stopped …" if going.stopping else " is being made …"
    return [
        paragraph(joined(name, text(doing))),
        progress_bar(going.share),
        row(button("Cancel", "export.cancel", disabled=going.stopping, kind="danger")),
    ]


def _size(count: int) -> str:
    return f"{count / 1e6:.1f} MB" if count >= 1e6 else f"{max(1, round(count / 1e3))} kB"
