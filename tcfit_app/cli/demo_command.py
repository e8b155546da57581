"""`tcfit demo`: review the demo clip, or fit it, of which the truth is known, and say how far off the fit is."""

import dataclasses
import sys
from pathlib import Path

import numpy as np

from fitting_core.body.model import JOINT
from fitting_core.body.params import BodyParams
from fitting_core.body.points.positions import joints_in_space
from fitting_core.clip import Clip
from fitting_core.clips.demo import DemoClip, demo_clip
from fitting_core.clips.options import CameraOptions
from fitting_core.clips.reading import read_clip
from fitting_core.io.truth import Truth, read_truth
from fitting_core.measure.references.files import read_reference
from fitting_core.metrics import jitter, mpjpe, pa_mpjpe
from tcfit_app.cli.fit_command import Outcome, run_fit
from tcfit_app.options.fit import DemoOptions, FitOptions, fit_config
from tcfit_app.options.preparing import check_out, prepare_solver
from tcfit_app.project.project import Project
from tcfit_app.project.storage.accessing import check_free
from tcfit_app.project.storage.database import is_project

_PROJECT, _RESULT = Path("tcfit-demo.tcfit"), Path("tcfit-demo")
YOUR_OWN = "Now your own video, whose keypoints tcfit finds itself: tcfit review VIDEO --fit"
_BODY = slice(0, JOINT["right_wrist"] + 1)
_COLUMNS = ("in the camera", "pelvis aligned", "PA", "jitter mm/frame²")


def review_demo(options: DemoOptions) -> None:
    """Make a project of the demo clip if it is missing, and review it until Ctrl-C. Raises InputError as `review`
    does, or if the project cannot be written."""
    # viser, which a fit in the terminal does not need
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
        review(project, options.server, fit=config)
    print(YOUR_OWN, file=sys.stderr)


def run_demo(options: DemoOptions, *, command: str = "") -> Outcome:
    """Fit the demo clip, write the result, and print the errors against the truth. Raises InputError as `run_fit`
    does."""
    out = options.out or _RESULT
    check_out(out, overwrite=options.overwrite)
    clip = demo_clip()
    truth = read_truth(clip.truth)
    camera = CameraOptions(focal_length=clip.camera.focal[0], center=clip.camera.center)
    fit_options = FitOptions(
        video=clip.video,
        keypoints=clip.keypoints,
        out=out,
        overwrite=options.overwrite,
        overlay=options.overlay,
        threads=options.threads,
        camera=camera,
        method=options.method,
    )
    outcome = run_fit(fit_options, command=command)
    print("\n".join(truth_table(outcome, truth)))
    print(YOUR_OWN, file=sys.stderr)
    return outcome


def read_demo(demo: DemoClip) -> Clip:
    """What is fitted of the demo clip: its simulated keypoints, with its true camera."""
    camera = CameraOptions(focal_length=demo.camera.focal[0], center=demo.camera.center)
    clip = read_clip(demo.video, demo.keypoints, camera=camera)
    return dataclasses.replace(clip, name="demo")


def truth_table(outcome: Outcome, truth: Truth) -> list[str]:
    """Errors of the first and the last phase over the 22 joints of the body without hands and face, as lines.

    "In the camera" is what a user gets, depth included; the others take off where the body stands, and its rotation
    and size. The jitter of the truth itself stands below.
    """
    header = "".join(f"{column:>18}" for column in _COLUMNS)
    lines = [f"Mean error of body joints against the truth, in mm, over {len(truth.joints)} frames", f"{'':9}{header}"]
    phases = outcome.fit.phases
    for phase in (*phases[:1], *phases[1:][-1:]):
        numbers = "".join(f"{value:18.1f}" for value in joint_errors(outcome, phase.params, truth))
        lines.append(f"phase {phase.phase:<3}{numbers}")
    return [*lines, f"{'truth':9}{'':54}{jitter(truth.joints[:, _BODY]):18.1f}"]


def joint_errors(outcome: Outcome, params: BodyParams, truth: Truth) -> tuple[float, float, float, float]:
    """Mean joint error in mm in camera space, with the pelvis aligned, after Procrustes; and the jitter."""
    joints, true = joints_in_space(outcome.body, params)[:, _BODY], truth.joints[:, _BODY]
    absolute = 1e3 * np.linalg.norm(joints - true, axis=-1).mean()
    aligned = mpjpe(joints, true, [JOINT["pelvis"]]).mean()
    return float(absolute), float(aligned), float(pa_mpjpe(joints, true).mean()), jitter(joints)
