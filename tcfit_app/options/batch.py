"""The options of `tcfit batch`. Imports nothing heavy."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from fitting_core.clips.options import CameraOptions, ClipOptions
from tcfit_app.options.fit import BodyOptions, JsonLines, MethodOptions, shown


@dataclass(frozen=True, kw_only=True)
class BatchOptions:
    """Fit many clips, as a CSV file lists them; started again, it goes on where it was stopped.

    Columns: out (a folder for the result of each clip), video and keypoints (at least one of them; keypoints that are
    not given are found in the video), and any option below or setting of `tcfit settings` that is to differ between
    clips, by its name: focal_length, person, first_frame, preset, temporal.weight, ...; and start, start_person and
    start_first_frame as of `tcfit fit`. Empty cells take what the command line says. Paths are relative to the file.

    Each clip gives what `tcfit fit` gives. A clip that fails does not stop the others; it is fitted again with --retry,
    or when its files or settings change. What is done is left alone until then.
    """

    manifest: Annotated[Positional[Path], arg(metavar="CLIPS.csv")]
    """The list of clips. State, log and summary go into a folder beside it: CLIPS.batch."""
    jobs: Annotated[int | None, shown("N", "one for each core")] = None
    """Clips that are fitted at the same time, each in a process with one thread."""
    ray: Annotated[tuple[str] | tuple[()] | None, shown("[ADDRESS]", "this computer's processes")] = None
    """Fit on a running Ray cluster whose nodes see the same files: its address, or nothing for the one that Ray finds;
    "local" starts one here. Needs tcfit[ray]."""
    part_minutes: Annotated[float | None, shown("MINUTES", "the whole clip")] = None
    """Fit each clip that is longer in parts of so many minutes at most, under one shape: a folder for each in its
    `out`, named by the time at which it begins."""
    retry: bool = False
    """Fit clips again that failed before."""
    report: bool = False
    """Only print the state of each clip, and update summary.csv."""
    projects: bool = False
    """Make a project of each clip, to be reviewed, instead of a folder of files."""
    overlay: bool = True
    """Write overlay.mp4 beside each result: phase 1 and the final fit side by side."""
    overwrite: bool = False
    """Write into folders that hold other files too."""
    json: JsonLines = False
    clip: ClipOptions = field(default_factory=ClipOptions)
    camera: CameraOptions = field(default_factory=CameraOptions)
    body: BodyOptions = field(default_factory=BodyOptions)
    method: MethodOptions = field(default_factory=MethodOptions)
