"""The command line: what it accepts and refuses, exit codes, and what a fit, cancelled or not, leaves behind."""

import json
import re
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fitting_core.config.schema import PRESETS
from fitting_core.errors import InputError
from fitting_core.fit.events import FitEvent, PhaseFinished, PhaseStarted
from fitting_core.io.result_files import read_fit
from fitting_core.results.fit_result import FitResult
from fitting_core.results.provenance import Start
from tcfit_app.cli import fit_command
from tcfit_app.cli.main import main, parse
from tcfit_app.options import preparing
from tcfit_app.options.fit import fit_config
from tcfit_app.options.removed import REMOVED
from tests.drivers.processes import INTERRUPTIBLE
from tests.tcfit_app.conftest import FRAMES, FinishedRun

EVERY_OPTION = """
    fit walk.mp4 --keypoints kp --out o --people all --shape s.npz --overwrite --no-overlay --threads 2 --json
    --detector dwpose-l --person 1 --first-frame 3 --last-frame 9 --frame-rate 25
    --keypoint-scale 0..1 --image-size 640 480 --focal-length 900 --fov 60 --focal-length-35mm 35 --center 320 240
    --camera c.npz --camera-name left --camera-unit 0.001 --camera-up z
    --body-model smplh --models m --gender male --start wham_output.pkl --start-person 2 --start-first-frame 5
    --preset paper --config c.toml --temporal-weight 300 --window-size 9 --shape-sample 10 --device cuda --height 182.5
    --set hip_weight=1 --other-view b.mp4 --other-keypoints kb --other-focal-length 800 --other-person 2
    --other-first-frame 4
""".split()


def test_help_loads_no_heavy_package():
    code = """
import sys
from tcfit_app.cli.main import COMMANDS, main
for command in ([], *([name] for name in COMMANDS), ["models", "add"]):
    assert main([*command, "--help"]) == 0
    print(command, [m for m in ("torch", "cv2", "scipy", "pyrender", "viser") if m in sys.modules])
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    found = [line for line in done.stdout.splitlines() if line.startswith("[")]
    assert len(found) == 14 and all(line.endswith(" []") for line in found) and "usage: tcfit" in done.stdout


def test_the_version_is_printed(capsys: pytest.CaptureFixture[str]):
    assert main(["--version"]) == 0
    assert re.fullmatch(r"tcfit \d+\.\d+\.\d+\S*\n", capsys.readouterr().out)


def test_every_option_is_read():
    options = parse(EVERY_OPTION)
    plain = parse(["fit", "--out", "o"])
    for group in ("clip", "camera", "views", "body", "begin", "method"):
        given, default = vars(getattr(options, group)), vars(getattr(plain, group))
        assert [name for name in given if given[name] == default[name]] == []
    assert [name for name in vars(options) if getattr(options, name) == getattr(plain, name)] == ["out"]
    assert options.camera.center == (320, 240) and options.clip.image_size == (640, 480)
    assert options.video == Path("walk.mp4") and options.method.set == ("hip_weight=1",)


def _config(*arguments: str) -> Any:
    return fit_config(parse(["fit", "--out", "o", *arguments]).method)


@pytest.mark.parametrize("given", [["--device", "mps"], ["--set", "device=mps"]])
def test_a_device_that_lacks_the_precision_is_refused(given: list[str]):
    with pytest.raises(InputError, match="device mps cannot compute in float64"):
        _config(*given)
    assert _config(*given, "--set", "precision=float32").device == "mps"


@pytest.mark.parametrize("used", REMOVED)
def test_what_was_removed_names_its_replacement(used: str, capsys: pytest.CaptureFixture[str]):
    command, *option = used.split()
    for given in ([command, *option, "3"], [command, f"{option[0]}=3"] if option else [command]):
        assert main(given) == 2
        assert capsys.readouterr().err == f"tcfit: tcfit {used} was removed. {REMOVED[used]}\n"


def test_preset_then_file_then_command_line(tmp_path: Path):
    path = tmp_path / "mine.toml"
    path.write_text('preset = "paper"\nhip_weight = 0.25\n[temporal]\nweight = 5\nwindow_size = 11\n')
    assert _config() == PRESETS["tcfit"] and _config("--preset", "smplifyx") == PRESETS["smplifyx"]
    by_file = _config("--config", str(path))
    assert (by_file.yaws, by_file.hip_weight, by_file.temporal.weight) == ("side_view", 0.25, 5.0)
    over = _config("--config", str(path), "--preset", "tcfit", "--window-size", "3", "--set", "temporal.weight=7")
    assert (over.yaws, over.hip_weight) == ("four", 0.25)
    assert (over.temporal.weight, over.temporal.window_size) == (7.0, 3)


REFUSED = {
    "unknown setting": (["--set", "weights.bodypose=1"], "no setting 'weights.bodypose'; did you mean weights.body_"),
    "setting without its group": (["--set", "window_size=3"], "did you mean temporal.window_size?"),
    "no value": (["--set", "hip_weight"], "--set hip_weight: expected hip_weight=VALUE, a number"),
    "count": (["--set", "weights.shape=1,2"], "weights.shape is 1,2; expected 5 numbers, one for each stage"),
    "choice": (["--set", "solver=adam"], "--set: solver is adam; expected one of lm, lbfgs"),
    "number": (["--temporal-weight", "much"], "--temporal-weight: temporal.weight is much; expected a number"),
    "range": (["--window-size", "1"], "--window-size: temporal.window_size is 1; expected 2 or more"),
    "negative": (["--set", "shape_sample.seed=-3"], "--set: shape_sample.seed is -3; expected 0 or more"),
    "twice": (["--height", "170", "--set", "height=180"], "given twice, by --height and --set"),
    "preset": (["--preset", "papr"], "--preset: there is no preset 'papr'; expected one of smplifyx, paper, tcfit"),
    "no file": (["--config", "none.toml"], "none.toml: cannot be read"),
    "device": (["--device", "gpu"], "device is 'gpu'; expected cpu"),
    "absent device": (["--device", "cuda:77"], "--device cuda:77 cannot be used"),
    "threads": (["--threads", "-1"], "--threads is -1; expected 0 (one for each"),
    "two focal lengths": (["--fov", "60"], "The focal length is given 2 times"),
    "person": (["--person", "4"], "person=4, but no frame of"),
    "frames": (["--first-frame", "90"], "Frames 90 to 5 were asked for (--first-frame, --last-frame)"),
    "scale": (["--keypoint-scale", "cm"], "--keypoint-scale is 'cm'; expected one of auto, pixels"),
    "gender": (["--gender", "other"], "'other' is not a gender, expected one of neutral, male, female, child"),
    "body": (["--body-model", "scape"], "'scape' is not a body model, expected one of smplx"),
    "no such body": (
        ["--body-model", "smplh", "--models", "."],
        "Or leave out --body-model and --models to use",
    ),
    "body file": (["--body-model", "nowhere/SMPLX_MALE.npz"], "SMPLX_MALE.npz: does not exist"),
    "folder and file": (["--body-model", "a.npz", "--models", "m"], "a file, cannot be combined with --models m"),
    "shape and height": (
        ["--shape", "s.npz", "--height", "172"],
        "--shape cannot be combined with --height",
    ),
    "models": (["--models", "."], "No neutral SMPL-X body"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refused(
    case: str, fit_arguments: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
):
    monkeypatch.chdir(tmp_path)
    arguments, message = REFUSED[case]
    assert main([*fit_arguments, *arguments]) == 2
    err = capsys.readouterr().err
    assert err.startswith("tcfit: ") and message in err and err.count("tcfit: ") == 1
    assert not (tmp_path / "out").exists()


OWN_NAMES = {
    "a folder": (["--keypoints", "frame_rate/first_frame"], "No keypoint files in frame_rate/first_frame: found"),
    "a video": (["image_size.mp4"], "image_size.mp4 does not exist"),
    "keys of a file": (["--keypoints", "frame_rate", "--camera", "keypoint_scale.json"],
        "keypoint_scale.json: has no camera matrix in it (it has camera_name, focal_length, first_frame)"),
}  # fmt: skip


@pytest.mark.parametrize("case", OWN_NAMES)
def test_names_of_the_user_s_own_stay_as_they_are(
    case: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
):
    """Also where options of the library are called so, whose names become the command line's."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "frame_rate" / "first_frame").mkdir(parents=True)
    body = {"people": [{"pose_keypoints_2d": [5.0, 6.0, 0.5] * 25}]}
    (tmp_path / "frame_rate" / "walk_0_keypoints.json").write_text(json.dumps(body))
    content = '{"camera_name": "D400", "focal_length": 650, "first_frame": 0}'
    (tmp_path / "keypoint_scale.json").write_text(content)
    arguments, message = OWN_NAMES[case]
    assert main(["fit", *arguments, "--out", "o"]) == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["fit", "--out", "o", "--windw-size", "3"], "--window-size"),
        (["fit"], "--out"),
        (["fit", "--out", "o", "--center", "3"], "--center"),
        (["fit", "--out", "o", "--frame-rate", "fast"], "--frame-rate"),
        (["fti"], "fit, new, review, demo, detect"),
        ([], "Missing subcommand"),
    ],
)
def test_wrong_command_lines(arguments: list[str], message: str, capsys: pytest.CaptureFixture):
    assert main(arguments) == 2
    assert message in capsys.readouterr().err


def test_errors_of_a_process_have_no_traceback(tmp_path: Path):
    command = ["fit", "--keypoints", str(tmp_path / "none"), "--out", str(tmp_path / "out")]
    done = subprocess.run([sys.executable, "-m", "tcfit_app", *command], capture_output=True, text=True)
    assert done.returncode == 2 and done.stdout == ""
    assert done.stderr.startswith("tcfit: No keypoints at") and "Traceback" not in done.stderr


def test_fit(finished: FinishedRun):
    assert finished.code == 0
    assert sorted(path.name for path in finished.folder.iterdir()) == ["fit.npz", "summary.json"]
    assert "Focal length 800.0 px: focal length of 800 pixels, as given" in finished.err
    assert "30 frames per second are assumed. Give --frame-rate." in finished.err
    assert [line for line in finished.err.splitlines() if line.startswith("Phase ")] == [
        "Phase 1: first pass",
        "Phase 2: one shape",
        "Phase 3: final fit",
    ]
    assert f"Wrote fit.npz, summary.json into {finished.folder}" in finished.out and "phase 3" in finished.out
    stored = read_fit(finished.folder)
    assert stored.complete and stored.last_phase == 3 and len(stored.params) == FRAMES
    assert stored.camera.focal == (800, 800) and stored.camera.size == (640, 480)
    summary = json.loads((finished.folder / "summary.json").read_text())
    assert summary["complete"] is True and summary["config"]["settings"]["iterations"] == 6
    assert summary["command"].startswith("tcfit fit --keypoints ")
    assert summary["reprojection_px"]["phase3"]["median"] < 2
    assert (
        summary["jitter"]["phase3"]["camera_space_mm_per_frame2"]
        < summary["jitter"]["phase1"]["camera_space_mm_per_frame2"]
    )


def test_a_fit_begins_with_another_result(
    fit_arguments: list[str], finished: FinishedRun, tmp_path: Path, capsys: pytest.CaptureFixture
):
    """And says which; the options that say more of it need it."""
    start = ["--start", str(finished.folder / "fit.npz"), "--set", "last_phase=1"]
    assert main([*fit_arguments, *start, "--set", "start_deviation=0.1"]) == 0
    told = "Phase 1 begins with fit.npz, read as tcfit SMPL-X npz, in"
    assert told in capsys.readouterr().err
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["start"]["frames"] == summary["start"]["clip_frames"] == FRAMES
    assert summary["config"]["start_deviation"] == 0.1 and any(told in warning for warning in summary["warnings"])
    found = np.load(tmp_path / "out" / "fit.npz", allow_pickle=False)
    assert set(found["start"].tolist()) <= {int(Start.GIVEN), int(Start.FRAME_BEFORE), int(Start.FRAME_AFTER)}
    assert main([*fit_arguments, "--start-person", "1"]) == 2
    assert "--start-person without --start" in capsys.readouterr().err


USUAL = "35 mm equivalent of 32 mm, typical of phones and cameras, with 80 % confidence"
RULES = {
    "estimated": ([], USUAL),
    "as published": (["--preset", "paper"], "not known: assumed to be the image diagonal"),
    "asked for": (["--preset", "paper", "--focal-length", "auto"], USUAL),
    "diagonal": (["--focal-length", "diagonal"], "not known: assumed to be the image diagonal"),
}


@pytest.mark.usefixtures("replayed")
@pytest.mark.parametrize("options, told", RULES.values(), ids=RULES)
def test_guessed_focal_length_is_told(
    fit_arguments: list[str], options: list[str], told: str, capsys: pytest.CaptureFixture
):
    at = fit_arguments.index("--focal-length")
    assert main([*fit_arguments[:at], *fit_arguments[at + 2 :], *options, "--set", "last_phase=1"]) == 0
    err = capsys.readouterr().err
    assert f" px: {told}" in err and "--focal-length-35mm" in err


@pytest.mark.usefixtures("replayed")
def test_other_files_are_not_written_among(fit_arguments: list[str], tmp_path: Path, capsys: pytest.CaptureFixture):
    out = tmp_path / "out"
    out.mkdir()
    (out / "thesis.tex").write_text("mine")
    assert main(fit_arguments) == 2
    assert "thesis.tex" in capsys.readouterr().err and [p.name for p in out.iterdir()] == ["thesis.tex"]
    quick = [*fit_arguments, "--set", "last_phase=1"]
    assert main([*quick, "--overwrite"]) == 0
    assert (out / "thesis.tex").read_text() == "mine" and read_fit(out).last_phase == 1
    assert main(quick) == 0, "a former result is replaced"


@pytest.fixture
def replayed(finished: FinishedRun, monkeypatch: pytest.MonkeyPatch) -> None:
    """The fit is not made again: these tests are about what the command does with it."""
    monkeypatch.setattr("fitting_core.fit.fitting.fit_events", finished.replay)


def _stopping(
    finished: FinishedRun, after: int | None, error: type[BaseException]
) -> Callable[..., Iterator[FitEvent]]:
    """fit_events that raise after a phase has finished; None: when the first one starts."""

    def events(*arguments: Any, **options: Any) -> Iterator[FitEvent]:
        for event in finished.replay(*arguments, **options):
            yield event
            if isinstance(event, PhaseStarted if after is None else PhaseFinished) and event.phase == (after or 1):
                raise error

    return events


@pytest.mark.parametrize("phase", [None, 1, 2])
def test_ctrl_c_keeps_finished_phases(
    phase: int | None,
    finished: FinishedRun,
    fit_arguments: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture,
):
    monkeypatch.setattr("fitting_core.fit.fitting.fit_events", _stopping(finished, phase, KeyboardInterrupt))
    assert main(fit_arguments) == 130
    err = capsys.readouterr().err
    if phase is None:
        assert "Nothing was written" in err and not (tmp_path / "out").exists()
        return
    assert f"The result up to phase {phase} is in {tmp_path / 'out'}" in err and "Traceback" not in err
    stored = read_fit(tmp_path / "out")
    assert not stored.complete and stored.last_phase == phase
    assert np.isfinite(stored.joints).all()
    assert (stored.params.betas == stored.params.betas[0]).all().item() == (phase == 2)
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["complete"] is False and f"phase{phase}" in summary["seconds"]


@pytest.mark.usefixtures("replayed")
def test_what_could_not_be_written_does_not_count(
    fit_arguments: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
):
    def full(folder: Path, fit: FitResult, *_: object, **__: object) -> dict:
        if fit.last is fit.phases[0]:
            return {}
        raise InputError("No space left.")

    monkeypatch.setattr(fit_command, "write_result", full)
    assert main(fit_arguments) == 2
    assert "Stopped. The result up to phase 1 is in" in capsys.readouterr().err


def test_a_folder_that_cannot_be_written_is_told_at_once(
    fit_arguments: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
):
    monkeypatch.setattr(preparing.os, "access", lambda path, mode: path != tmp_path)
    assert main(fit_arguments) == 2
    told = capsys.readouterr().err
    assert f"{tmp_path} is read-only" in told and "Phase" not in told


@pytest.mark.thorough
def test_interrupt_signal_ends_a_process(clip_arguments: list[str], tmp_path: Path):
    code = f"{INTERRUPTIBLE}import sys\nfrom tcfit_app.cli.main import main; sys.exit(main())"
    # What follows the line "Phase 2" takes seconds: five stages in each of five windows.
    slow = ["--preset", "paper", "--window-size", "2", "--set", "settings.stage_tolerance=1e-12"]
    slow += ["--set", "relay_rounds=0", "--set", "yaws=side_view", "--no-overlay"]
    slow += ["--set", "weights.collision=[0, 0, 0, 0, 0]"]
    command = [sys.executable, "-c", code, "fit", *clip_arguments, "--out", str(tmp_path / "out"), *slow]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        for line in process.stderr:
            if line.startswith("Phase 2"):
                process.send_signal(signal.SIGINT)
                break
        rest = process.stderr.read()
    assert "Stopped. The result up to phase" in rest and "Traceback" not in rest
    assert process.returncode == 130
    assert not read_fit(tmp_path / "out").complete


@pytest.mark.usefixtures("replayed")
def test_missing_opengl_does_not_fail_the_fit(
    fit_arguments: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
):
    def nothing(*arguments: Any, **options: Any) -> None:
        raise InputError("No off-screen OpenGL was found. On Debian or Ubuntu, `apt-get install libegl1 libgl1`")

    monkeypatch.setattr(fit_command, "write_comparison", nothing)
    assert main([*fit_arguments, "--overlay", "--set", "last_phase=1"]) == 0
    told = capsys.readouterr()
    assert "overlay.mp4 was not written, but the fit is complete. No off-screen OpenGL" in told.err
    assert "Wrote fit.npz, summary.json into" in told.out


def test_settings_are_a_configuration_file(tmp_path: Path, capsys: pytest.CaptureFixture):
    assert main(["settings", "--preset", "paper", "--window-size", "9"]) == 0
    (tmp_path / "mine.toml").write_text(capsys.readouterr().out)
    assert _config("--config", str(tmp_path / "mine.toml")) == _config("--preset", "paper", "--window-size", "9")


def test_models_are_listed_and_added(tmp_path: Path, capsys: pytest.CaptureFixture):
    assert main(["models"]) == 0 and main(["models", "list"]) == 0
    first, second = capsys.readouterr().out.split("MODEL ")[1:]
    assert first == second and "SMPLX_NEUTRAL.npz" in first
    for given, message in (([str(tmp_path / "none.zip")], "none.zip"), ([], "no path given")):
        assert main(["models", "add", *given]) == 2 and message in capsys.readouterr().err


@pytest.mark.parametrize("option", ["--body-model ", "--detector ", "--set pose_prior="])
def test_a_path_that_is_too_long_where_a_name_may_be(option: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert main(["fit", "clip.mp4", "--out", str(tmp_path / "out"), *f"{option}{'a' * 5000}".split()]) == 2
    assert "is too long; expected names of at most 255 bytes" in capsys.readouterr().err
