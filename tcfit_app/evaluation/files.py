"""The output of `tcfit evaluate`: a table in the terminal, metrics.csv, metrics.json and report.html."""

import csv
import io
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

import msgspec
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from fitting_core.errors import InputError
from fitting_core.files.atomic import replacing
from fitting_core.measure.comparison import figure_titles
from fitting_core.measure.limbs import LIMB_FIGURES
from fitting_core.measure.records import Evaluation, Record, methods, motions, number, of, overall
from fitting_core.measure.report import report_page

CSV_NAME, JSON_NAME, REPORT_NAME = "metrics.csv", "metrics.json", "report.html"
FORMAT = "tcfit evaluation 1"
_PRINTED = (
    "vertex_to_surface_mean",
    "vertex_to_surface_std",
    "volume_error_mean",
    "pa_mpjpe_mean",
    "mpjpe_mean",
    *LIMB_FIGURES,
    "joint_error_mean",
    "acceleration_error_mean",
    "jitter",
    "jitter_truth",
    "reprojection_mean",
    "reprojection_body_mean",
    "reprojection_hands_mean",
    "reprojection_face_mean",
)


def write_evaluation(folder: Path, evaluation: Evaluation) -> tuple[Path, ...]:
    """Write metrics.csv, metrics.json and, if plotly is installed, report.html: all of them whole or none.

    Returns:
        The files.

    Raises:
        InputError: The folder cannot be written.
    """
    content = {"format": FORMAT, "title": evaluation.title, "settings": evaluation.settings}
    content |= {"notes": evaluation.notes, "records": evaluation.records}
    files = {
        CSV_NAME: as_csv(evaluation.records).encode(),
        JSON_NAME: msgspec.json.format(msgspec.json.encode(content), indent=1) + b"\n",
    }
    try:
        files[REPORT_NAME] = report_page(evaluation).encode()
    except InputError as error:
        print(f"Note: {REPORT_NAME} is not written, because {error}", file=sys.stderr)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with ExitStack() as drafts:  # none takes its place before all are written
            for name, data in files.items():
                drafts.enter_context(replacing(folder / name)).write_bytes(data)
            if REPORT_NAME not in files:
                (folder / REPORT_NAME).unlink(missing_ok=True)  # of an earlier evaluation
    except OSError as error:
        raise InputError(
            f"{folder}: cannot be written ({error.strerror or error}). Free space, or choose another --out."
        ) from error
    return tuple(folder / name for name in files)


def as_csv(records: Sequence[Record]) -> str:
    """A line for each record, a column for each figure with its unit; empty if not measured."""
    titles = figure_titles()
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    names = [name for name in titles if any(r.comparison.figures.get(name) is not None for r in records)]
    units = [f"{name} [{titles[name][1]}]" if titles[name][1] else name for name in names]
    writer.writerow(["sequence", "motion", "method", "frames", "compared_frames", "seconds", *units])
    for r in records:
        values = [r.comparison.figures.get(name) for name in names]
        shown = ["" if value is None else f"{value:.6g}" for value in values]
        compared = r.comparison.compared_frames
        writer.writerow([r.sequence, r.motion, r.method, r.frames, compared, f"{r.seconds:.3f}", *shown])
    return text.getvalue()


def print_table(records: Sequence[Record]) -> None:
    """The main figures, a column for each method, by motion, over all its frames."""
    titles, console = figure_titles(), Console()
    for motion in motions(records):
        some = of(records, motion=motion)
        names = methods(some)
        table = Table(title=motion.capitalize() or None, title_justify="left", box=SIMPLE_HEAD, pad_edge=False)
        table.add_column("", no_wrap=True)
        for name in names:
            table.add_column(name.replace(", ", "\n"), justify="right", no_wrap=True)
        for figure in _PRINTED:
            values = [overall(of(some, method=name), figure) for name in names]
            if any(value is not None for value in values):
                title, unit, _ = titles[figure]
                table.add_row(f"{title.replace('standard deviation', 'std')}, {unit}", *map(number, values))
        console.print(table)
