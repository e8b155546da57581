"""`tcfit models`: the table and the registration."""

import re
from dataclasses import replace
from pathlib import Path

import pytest

from fitting_core.body.files import registry
from fitting_core.detect.detectors import DETECTORS
from fitting_core.detect.known_models import KNOWN_MODELS
from fitting_core.detect.mediapipe import networks, packages
from fitting_core.errors import InputError
from fitting_core.priors.files import registry as priors
from fitting_core.priors.files.network import write_prior_network
from tcfit_app.cli.doctor import check_detector
from tcfit_app.cli.models_command import list_models, register_models
from tests.fitting_core.detect.mediapipe.fake_packages import asked, fake_programs, know, make_packages
from tests.fitting_core.detect.onnx_files import brightest_model
from tests.fitting_core.priors.networks import random_network
from tests.fitting_core.priors.test_vposer import folder_1, trained, version_1
from tests.samples.body_files import body_arrays, write_npz


@pytest.fixture
def places(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Folders of this test in place of the user's: `data` for registered bodies, `free` for those that come along."""
    monkeypatch.setattr(registry, "user_folder", lambda: tmp_path / "data")
    monkeypatch.setattr(registry, "FREE_FOLDER", tmp_path / "free")
    monkeypatch.setattr("tcfit_app.cli.models_command.user_folder", lambda: tmp_path / "data")
    monkeypatch.setattr(priors, "user_file", lambda: tmp_path / "data" / "vposer.npz")
    monkeypatch.setattr(priors, "POSE_PRIOR", tmp_path / "free" / "prior.npz")
    monkeypatch.delenv(registry.ENVIRONMENT, raising=False)
    monkeypatch.setenv("TCFIT_DETECTORS", str(tmp_path / "detectors"))
    return tmp_path


def test_table_of_models(places: Path, capsys: pytest.CaptureFixture[str]):
    free = write_npz(places / "free" / "SMPLX_NEUTRAL.npz", body_arrays())
    own = write_npz(places / "data" / "SMPLH_FEMALE.npz", body_arrays("smplh"))
    list_models()
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split() == ["MODEL", "GENDER", "VERTICES", "FROM", "FILE"]
    assert lines[1].split() == ["SMPL-H", "female", "60", "yours", str(own)]
    assert lines[2].split() == ["SMPL-X", "neutral", "60", "comes", "with", "tcfit", str(free)]
    assert len({line.index(str(path)) for line, path in zip(lines[1:3], (own, free), strict=True)}) == 1


def test_damaged_model_is_shown_with_its_problem(places: Path, capsys: pytest.CaptureFixture[str]):
    (places / "free").mkdir()
    (places / "free" / "SMPLX_MALE.npz").write_bytes(b"x")
    list_models()
    out = capsys.readouterr().out
    assert "damaged" in out and "Cannot be read:" in out and "not a complete npz archive" in out


def test_without_models_the_folders_are_named(places: Path, capsys: pytest.CaptureFixture[str]):
    list_models()
    out = capsys.readouterr().out
    assert out.startswith("No body model found in")
    assert str(places / "data") in out and str(places / "free") in out and "tcfit models add" in out


def test_registered_models_are_shown(places: Path, capsys: pytest.CaptureFixture[str]):
    first = write_npz(places / "downloads" / "SMPLX_MALE.npz", body_arrays())
    second = write_npz(places / "other" / "smplh" / "female" / "model.npz", body_arrays("smplh"))
    register_models([first, places / "other"])
    out = capsys.readouterr().out
    assert str(places / "data" / "SMPLX_MALE.npz") in out and str(places / "data" / "SMPLH_FEMALE.npz") in out
    assert (places / "data" / "SMPLH_FEMALE.npz").read_bytes() == second.read_bytes()


def test_pose_priors_are_added_and_shown(places: Path, capsys: pytest.CaptureFixture[str]):
    own = places / "data" / "vposer.npz"
    register_models([folder_1(places / "downloads" / "vposer_v1_0", trained(version_1))])
    assert capsys.readouterr().out.splitlines()[-1].split() == ["vposer", "VPoser", "1", "yours", str(own)]
    (places / "free").mkdir()
    write_prior_network(places / "free" / "prior.npz", random_network())
    list_models()
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    start = lines.index(["POSE", "PRIOR", "KIND", "FROM", "FILE"])
    assert lines[start + 1] == ["vposer", "VPoser", "1", "yours", str(own)]
    assert lines[start + 2] == ["tcfit", "random", "comes", "with", "tcfit", str(places / "free" / "prior.npz")]
    own.write_bytes(b"x")
    list_models()
    out = capsys.readouterr().out
    assert "damaged" in out and f"Cannot be read: {own}" in out


@pytest.fixture
def packages_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Packages with tiny networks that are taken for MediaPipe's, and programs that fetch them."""
    folder = make_packages(tmp_path / "packages")
    know(folder, monkeypatch.setitem, lambda sha256: monkeypatch.setattr(packages, "WHEEL_SHA256", sha256))
    monkeypatch.setattr(packages, "programs", lambda: fake_programs(folder))
    return folder


def test_networks_are_fetched_once_the_user_agrees(
    places: Path, packages_folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    with pytest.raises(InputError, match="Give --yes"):
        register_models([Path("mediapipe")])
    monkeypatch.setattr("sys.stdin.isatty", lambda: True, raising=False)
    answers = iter(["", "y"])
    monkeypatch.setattr("builtins.input", lambda question: next(answers))
    with pytest.raises(InputError, match=r"Nothing was downloaded\."):
        register_models([Path("mediapipe")])
    assert asked(packages_folder) == []
    capsys.readouterr()
    register_models([Path("mediapipe")])
    out = capsys.readouterr().out
    assert "Apache-2.0" in out and "36 MB" in out and f"In {networks.folder()}: pose_detection, " in out
    register_models([Path("mediapipe")], agreed=True)
    assert "already" in capsys.readouterr().out and asked(packages_folder) == ["download", "pack"]


def test_networks_are_taken_from_files_and_shown(
    places: Path, packages_folder: Path, capsys: pytest.CaptureFixture[str]
):
    list_models()
    states = [line.rsplit("  ")[-1] for line in capsys.readouterr().out.splitlines() if line.startswith("pose_")]
    assert states == ["missing", "missing", "missing (optional)"]
    assert [check.status for check in check_detector()] == ["warning"]
    register_models([next(packages_folder.glob("*.whl"))])
    assert "Note: pose_landmark_heavy: not there" in capsys.readouterr().out
    (check,) = check_detector()
    assert (
        check.status == "ok"
        and "the larger one for bodies (optional) is missing" in check.found
        and "tcfit models add" in check.advice
    )
    register_models([next(packages_folder.glob("*.tgz"))])
    networks.onnx_path("pose_landmark_full", networks.folder()).write_bytes(b"x")
    capsys.readouterr()
    list_models()
    states = [line.split()[-1] for line in capsys.readouterr().out.splitlines() if line.startswith("pose_")]
    assert states == ["installed", "damaged", "installed"]
    (check,) = check_detector()
    assert check.status == "warning" and "pose_landmark_full.onnx: is damaged" in check.found
    register_models([Path("mediapipe")], agreed=True)
    (check,) = check_detector()
    assert check.status == "ok" and not check.advice


def test_detectors_are_listed_and_downloaded_with_all_they_need(
    places: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    def states() -> dict[str, str]:
        list_models()
        lines = capsys.readouterr().out.splitlines()
        lines = lines[next(n for n, line in enumerate(lines) if line.startswith("DETECTOR")) + 1 :]
        rows = [re.split(r"  +", line) for line in lines[: len({*DETECTORS, *KNOWN_MODELS})]]
        assert all(row[1] for row in rows)
        return {row[0]: row[2].split()[0] for row in rows}

    assert states() == dict.fromkeys([*DETECTORS, *KNOWN_MODELS], "missing")
    model = brightest_model(places / "pose.onnx", size=(96, 128))
    for name in ("dwpose-m", "rtmdet-nano"):
        monkeypatch.setitem(KNOWN_MODELS, name, replace(KNOWN_MODELS[name], url=model.resolve().as_uri()))
    with pytest.raises(InputError, match="Give --yes"):
        register_models([Path("dwpose-m")])
    register_models([Path("dwpose-m")], agreed=True)
    said, known = capsys.readouterr().out, KNOWN_MODELS["dwpose-m"]
    assert known.url in said and known.licence in said and "stored for the next download" in said
    assert {name for name, state in states().items() if state == "installed"} == {"dwpose-m", "rtmdet-nano"}
    register_models([Path("rtmdet-nano")], agreed=True)
    assert "(as expected)" in capsys.readouterr().out
