"""`tcfit demo`: review the demo clip, whose truth is the project's reference."""

import dataclasses
import sys
from pathlib import Path

from fitting_core.clip import Clip
from fitting_core.clips.demo import DemoClip, demo_clip
from fitting_core.clips.options import CameraOptions
from fitting_core.clips.reading import read_clip
from fitting_core.measure.references.files import read_reference
from tcfit_app.options.fit import DemoOptions, fit_config
from tcfit_app.options.preparing import prepare_solver
from tcfit_app.project.project import Project
from tcfit_app.project.storage.accessing import check_free
from tcfit_app.project.storage.database import is_project

_PROJECT = Path("tcfit-demo.tcfit")


def review_demo(options: DemoOptions) -> None:
    """Make a project of the demo clip if it is missing, and review it until Ctrl-C. Raises InputError as `review`
    does, or if the project cannot be written."""
    # viser, which takes a second to import
    from tcfit_app.cli.review_command import check_folders, review
    from tcfit_app.review.opening import open_project

    check_folders(options.server)
    config = fit_config(options.method)
    folder = options.out or _PROJECT
    if not is_project(folder):
        check_free(folder)
        demo = demo_clip()
        with Project.create(folder, read_demo(demo), copy_media=True) as project:
            project.set_reference(read_reference(demo.truth))
    prepare_solver(config, options.threads)
    with open_project(folder) as project:
        review(project, options.server, fit=config, plays=True)
    print("Now your own video, whose keypoints tcfit finds itself: tcfit review VIDEO --fit", file=sys.stderr)


def read_demo(demo: DemoClip) -> Clip:
    """The demo clip with its simulated keypoints and its true camera."""
    camera = CameraOptions(focal_length=demo.camera.focal[0], center=demo.camera.center)
    clip = read_clip(demo.video, demo.keypoints, camera=camera)
    return dataclasses.replace(clip, name="demo")
