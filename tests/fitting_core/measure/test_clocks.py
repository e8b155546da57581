"""References of laboratories whose clocks are not the video's: the offset, and errors as against the truth itself."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import ezc3d
import numpy as np
import pytest
import torch

from fitting_core.body.markers.marker_set import STANDARD, MarkerSet, marker_places
from fitting_core.body.markers.places import PLACES
from fitting_core.body.model import JOINTS, BodyModel
from fitting_core.body.params import BodyParams
from fitting_core.body.points.positions import joints_in_space
from fitting_core.errors import InputError
from fitting_core.io.points.named_points import NamedPoints
from fitting_core.io.points.trc import write_trc
from fitting_core.measure.clocks import found_offset
from fitting_core.measure.comparison import compare
from fitting_core.measure.pairing import PosedMotion
from fitting_core.measure.references.bodies import reference_of
from fitting_core.measure.references.files import read_reference
from fitting_core.measure.references.resampling import at_frames_of

RATE, OWN_RATE, SECONDS = 30.0, 60.0, 6.0
START = -0.37
"""The laboratory's first frame in the video's time: it began earlier."""
TURN = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]])
SHIFT = np.array([0.1, 1.5, 4.0])


def acted(seconds: np.ndarray, *, period: float | None = None, seed: int = 4) -> BodyParams:
    """A person who moves all limbs, once or again and again, at any moments."""
    draw = np.random.default_rng(seed)
    waves, phase = draw.normal(0, 0.35, (5, 63)), draw.uniform(0, 2 * np.pi, (5, 63))
    rates = np.array([0.31, 0.47, 0.83, 1.13, 1.7]) if period is None else np.arange(1, 6) / period
    angles = 2 * np.pi * rates[:, None, None] * seconds[None, :, None] + phase[:, None]
    body = (waves[:, None] * np.sin(angles)).sum(0) * np.repeat(_FREE, 3)
    params = BodyParams.neutral(len(seconds))
    root = np.stack([np.pi + 0 * seconds, 0.2 * np.sin(seconds), 0 * seconds], -1)
    there = np.stack([0.3 * np.sin(0.9 * seconds), 0.1 + 0 * seconds, 4 + 0.2 * np.cos(seconds)], -1)
    return replace(
        params,
        body_pose=torch.as_tensor(body),
        global_orient=torch.as_tensor(root),
        camera_translation=torch.as_tensor(there),
    )


_FREE = np.array([name.split("_")[-1] in ("hip", "knee", "shoulder", "elbow", "wrist") for name in JOINTS[1:22]])


@pytest.fixture(scope="module")
def fit(free_body: BodyModel) -> PosedMotion:
    """What was fitted: the truth at the video's frames, each joint off by some degrees."""
    params = acted(np.arange(0, SECONDS, 1 / RATE))
    wrong = torch.as_tensor(np.random.default_rng(1).normal(0, 0.04, params.body_pose.shape))
    return PosedMotion(
        body=free_body, params=replace(params, body_pose=params.body_pose + wrong), camera=None, frame_rate=RATE
    )


def places_of(body: BodyModel, seconds: np.ndarray, what: str, **more) -> tuple[tuple[str, ...], np.ndarray]:
    """Names and places in camera space of what a laboratory measured."""
    params = acted(seconds, **more)
    if what == "joints":
        return tuple(JOINTS), joints_in_space(body, params)
    return tuple(PLACES), marker_places(body, params, STANDARD)


def written(folder: Path, form: str, names: tuple[str, ...], places: np.ndarray) -> Path:
    """A file of another make: C3D by ezc3d, TRC line by line, in the laboratory's world (z up) and millimetres."""
    own = 1e3 * ((places - SHIFT) @ TURN)
    path = folder / f"laboratory.{form}"
    if form == "trc":
        write_trc(path, NamedPoints(names=names, places=own / 1e3, frame_rate=OWN_RATE))
        return path
    made = ezc3d.c3d()
    made["parameters"]["POINT"]["RATE"]["value"] = [OWN_RATE]
    made["parameters"]["POINT"]["UNITS"]["value"] = ["mm"]
    made["parameters"]["POINT"]["LABELS"]["value"] = [f"Anna:{name}" for name in names]
    points = np.ones((4, len(names), len(own)))
    points[:3] = own.transpose(2, 1, 0)
    made["data"]["points"] = points
    made.write(str(path))
    return path


@cache
def in_laboratory(body: BodyModel, what: str) -> tuple[tuple[str, ...], np.ndarray]:
    """At the laboratory's moments."""
    return places_of(body, START + np.arange(0, SECONDS + 0.7, 1 / OWN_RATE), what)


def measured(body: BodyModel, what: str, *, gaps: bool, noise: float) -> tuple[tuple[str, ...], np.ndarray]:
    """As cameras see it: with noise of so many metres, and markers out of sight for a second."""
    names, places = in_laboratory(body, what)
    draw = np.random.default_rng(2)
    places = places + draw.normal(0, noise, places.shape)
    if gaps:
        for point in range(0, len(names), 2):
            for start in draw.integers(0, len(places) - 60, 2):
                places[start : start + 60, point] = np.nan
    return names, places


@pytest.fixture(scope="module")
def camera(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("camera") / "camera.npz"
    np.savez(path, R=TURN, t=SHIFT)
    return path


def test_joints_of_a_laboratory_give_the_errors_of_the_truth(fit: PosedMotion, camera: Path, tmp_path: Path):
    joints = measured(fit.body, "joints", gaps=False, noise=0.0)
    reference, in_trc = (read_reference(written(tmp_path, form, *joints), camera=camera) for form in ("c3d", "trc"))
    np.testing.assert_allclose(in_trc.points, reference.points, atol=1e-5)
    assert len(reference) == len(in_trc) == 402 and reference.frame_rate == in_trc.frame_rate == OWN_RATE
    found = found_offset(fit, reference)
    assert found.seconds == pytest.approx(START, abs=0.004) and found.correlation > 0.98 > found.second + 0.3
    assert found.deviation is not None and found.deviation < 0.004
    in_time = at_frames_of(reference, RATE, start=START)
    truth = acted(np.arange(0, SECONDS, 1 / RATE))
    true_reference = reference_of("truth", "truth", fit.body, truth, frame_rate=RATE, in_camera=True)
    figures, true = (compare(fit, one, meshes=False).figures for one in (in_time, true_reference))
    for name in ("pa_mpjpe_mean", "mpjpe_mean", "joint_error_mean", "depth_error_mean"):
        assert figures[name] == pytest.approx(true[name], abs=0.1), name
    assert figures["acceleration_error_mean"] == pytest.approx(true["acceleration_error_mean"], rel=0.02)
    by_itself = compare(fit, at_frames_of(reference, RATE, start=found.seconds), meshes=False).figures
    assert by_itself["pa_mpjpe_mean"] == pytest.approx(true["pa_mpjpe_mean"], abs=1.0)
    assert by_itself["joint_error_mean"] == pytest.approx(true["joint_error_mean"], abs=1.0)


@pytest.mark.thorough
@pytest.mark.parametrize("form", ["trc", "c3d"])
@pytest.mark.parametrize("what", ["joints", "markers"])
def test_the_offset_is_found_with_noise_and_gaps(fit: PosedMotion, tmp_path: Path, form: str, what: str):
    path = written(tmp_path, form, *measured(fit.body, what, gaps=True, noise=0.004))
    found = found_offset(fit, read_reference(path))
    assert found.seconds == pytest.approx(START, abs=0.5 / RATE / 2)
    assert "-0.37" in found.text and "standard error" in found.text


def test_markers_are_compared_with_the_fit_s_own_markers(fit: PosedMotion, camera: Path, tmp_path: Path):
    """At the same vertices: so a fit without error has none, and one of other joints has theirs."""
    path = written(tmp_path, "c3d", *measured(fit.body, "markers", gaps=True, noise=0.0))
    reference = at_frames_of(read_reference(path, camera=camera), RATE, start=START)
    right = replace(fit, params=acted(np.arange(0, SECONDS, 1 / RATE)))
    figures = compare(right, reference, meshes=False).figures
    assert figures["joint_error_mean"] is not None and figures["joint_error_mean"] < 0.2
    assert figures["mpjpe_mean"] is not None and figures["mpjpe_mean"] < 0.2
    places = marker_places(fit.body, fit.params, STANDARD) - marker_places(fit.body, right.params, STANDARD)
    known = np.isfinite(reference.marker_places).all(-1) if reference.marker_places is not None else np.zeros(0)
    there = known[np.arange(len(places)) - reference.first_frame]
    expected = [1e3 * np.linalg.norm(p[k], axis=-1).mean() for p, k in zip(places, there, strict=True)]
    found = compare(fit, reference, meshes=False)
    assert found.compared_frames == len(places)
    assert found.figures["joint_error_mean"] == pytest.approx(np.mean(expected), abs=0.2)


def test_a_user_s_own_names(fit: PosedMotion, tmp_path: Path):
    names, places = measured(fit.body, "markers", gaps=False, noise=0.0)
    own = {f"P{i}": name for i, name in enumerate(names)}
    path = written(tmp_path, "trc", tuple(own), places)
    with pytest.raises(InputError, match=r"names 0 known points .* say with --markers"):
        read_reference(path)
    found = read_reference(path, markers=MarkerSet(own))
    assert found.markers is not None and list(found.markers.targets.values()) == list(names)
    assert found_offset(fit, found).seconds == pytest.approx(START, abs=0.005)


def test_movements_that_repeat_themselves_are_refused(fit: PosedMotion, tmp_path: Path):
    seconds = np.arange(0, SECONDS, 1 / RATE)
    repeating = replace(fit, params=acted(seconds, period=1.2))
    names, places = places_of(fit.body, START + np.arange(0, SECONDS + 4, 1 / OWN_RATE), "joints", period=1.2)
    reference = read_reference(written(tmp_path, "trc", names, places))
    with pytest.raises(InputError, match=r"not clear, as in movements that repeat .* 1\.20 s away"):
        found_offset(repeating, reference)


def test_other_movements_and_stillness_are_refused(fit: PosedMotion, tmp_path: Path):
    names, places = places_of(fit.body, np.arange(0, SECONDS, 1 / OWN_RATE), "joints", seed=9)
    reference = read_reference(written(tmp_path, "trc", names, places))
    with pytest.raises(InputError, match=r"no offset makes it move like the fit: the best .* of 0\.[0-6]"):
        found_offset(fit, reference)
    still = replace(fit, params=acted(np.zeros(60)))
    with pytest.raises(InputError, match="hardly anything moves"):
        found_offset(still, reference)
    short = replace(fit, params=fit.params[:20])
    with pytest.raises(InputError, match="too little in common"):
        found_offset(short, reference)
