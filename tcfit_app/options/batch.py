"""The options of `tcfit batch`. Imports nothing heavy."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from fitting_core.clips.options import CameraOptions, ClipOptions
from tcfit_app.options.fit import BodyOptions, JsonLines, MethodOptions, shown


@dataclass(frozen=True, kw_only=True)
class BatchOptions:
    """Fit the clips of a CSV file. The same command continues a batch that was stopped.

    Columns are options of `tcfit fit` and settings of `tcfit settings`, by name: video, keypoints, out, focal_length,
    first_frame, preset, temporal.weight, ... The column out is required, and video or keypoints. An empty cell has the
    value of the command line. Paths are relative to the CSV file.

    Each result is that of `tcfit fit`. Finished clips are skipped until their files or settings change. Failed clips do
    not stop the others; the same command fits them again.
    """

    manifest: Annotated[Positional[Path], arg(metavar="CLIPS.csv")]
    """The list of clips. CLIPS.batch/summary.csv beside it receives the outcome of each."""
    jobs: Annotated[int | None, shown("N", "one for each core")] = None
    """Number of clips that are fitted at the same time, each in its own process with one thread."""
    ray: Annotated[tuple[str] | tuple[()] | None, shown("[ADDRESS]", "this computer's processes")] = None
    """Fit on a Ray cluster whose nodes see the same files. Without an address: the one that Ray finds; local: start one
    here. Needs tcfit[ray]."""
    part_minutes: Annotated[float | None, shown("MINUTES", "the whole clip")] = None
    """Fit longer clips in parts of at most this length. Each part gets a folder in `out`, named by its start time."""
    overlay: bool = True
    """Write overlay.mp4 beside each result: phase 1 and the final fit side by side."""
    overwrite: bool = False
    """Write into folders that contain other files too."""
    json: JsonLines = False
    clip: ClipOptions = field(default_factory=ClipOptions)
    camera: CameraOptions = field(default_factory=CameraOptions)
    body: BodyOptions = field(default_factory=BodyOptions)
    method: MethodOptions = field(default_factory=MethodOptions)
