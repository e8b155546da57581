"""`--json`: every line is an event as docs/events.md has it, nothing else is on the standard output, and it ends."""

import json
import re
import subprocess
import sys
from contextlib import closing
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgspec
import pytest

from fitting_core.body.model import BodyModel
from fitting_core.io.result_files import write_result
from tcfit_app.batch.outcome import ClipOutcome
from tcfit_app.cli.batch_command import _Lines
from tcfit_app.cli.json_lines import EVENTS, SCHEMA, AnyEvent, StepProgress, emit, json_lines
from tcfit_app.cli.main import main
from tcfit_app.fitting.process_queue import Work
from tests.fitting_core.detect.onnx_files import brightest_model, spots
from tests.samples.media import write_film
from tests.samples.project_samples import sample_clip
from tests.samples.waving import waving_fit
from tests.tcfit_app.conftest import FinishedRun

PAGE = Path(__file__).parents[3] / "docs" / "events.md"


def lines(capsys: pytest.CaptureFixture[str]) -> list[dict[str, Any]]:
    """What was told; each is an event that we know, and the first and last are what they should be."""
    found = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    for event in found:
        msgspec.convert(event, AnyEvent)
    assert (found[0]["event"], found[0]["schema"], found[-1]["event"]) == ("started", SCHEMA, "ended")
    return found


def of(found: list[dict[str, Any]], event: str) -> list[dict[str, Any]]:
    return [line for line in found if line["event"] == event]


def test_the_page_has_every_event_with_its_fields():
    rows = re.findall(r"^\| `(\w+)` \| (.*?) \|", PAGE.read_text(), re.MULTILINE)
    stated = {name: tuple(re.findall(r"`(\w+)`", fields)) for name, fields in rows}
    assert stated == {kind.__struct_config__.tag: kind.__struct_fields__ for kind in EVENTS}


def test_the_page_shows_events_that_there_are():
    shown = re.findall(r'^\{"event".*$', PAGE.read_text(), re.MULTILINE)
    assert len(shown) > 4
    for line in shown:
        kind = type(event := msgspec.json.decode(line, type=AnyEvent))
        assert json.loads(line) == msgspec.to_builtins(event) and kind in EVENTS


def test_a_fit(
    fit_arguments: list[str],
    finished: FinishedRun,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    monkeypatch.setattr("fitting_core.fit.fitting.fit_events", finished.replay)
    assert main([*fit_arguments, "--json"]) == 0
    found = lines(capsys)
    assert [line["step"] for line in of(found, "step")] == ["phase 1", "phase 2", "phase 3"]
    assert all(line["seconds"] > 0 and line["cost"] > 0 for line in of(found, "step_done"))
    for phase in ("phase 1", "phase 3"):
        shares = [line["share"] for line in of(found, "progress") if line["step"] == phase]
        assert shares == sorted(shares) and len(shares) > 2
    fractions = [line["fraction"] for line in of(found, "progress")]
    assert fractions == sorted(fractions) and fractions[-1] > 0.6
    assert {line["text"] for line in of(found, "progress")} <= {"first pass", "one shape", "final fit"}
    assert [line["kind"] for line in of(found, "wrote")] == ["fit.npz", "summary.json"]
    assert all(Path(line["path"]).is_file() for line in of(found, "wrote"))
    assert of(found, "figures")[0]["figures"]["reprojection_px_median"] > 0
    assert found[-1]["code"] == 0


def test_an_export_and_an_evaluation(tmp_path: Path, free_body: BodyModel, capsys: pytest.CaptureFixture[str]):
    write_result(tmp_path / "fit", waving_fit(2.0), sample_clip(), free_body)
    out = tmp_path / "out"
    assert main(["export", str(tmp_path / "fit"), "--formats", "npz", "obj", "--out", str(out), "--json"]) == 0
    found = lines(capsys)
    assert [(line["kind"], Path(line["path"]).exists()) for line in of(found, "wrote")] == [
        ("npz", True),
        ("obj", True),
    ]
    assert of(found, "progress")[-1] == of(found, "progress")[-1] | {"step": "obj", "share": 1.0}

    given = ["--reference", str(tmp_path / "fit"), "--out", str(out / "e"), "--every", "3"]
    assert main(["evaluate", str(tmp_path / "fit"), *given, "--json"]) == 0
    found = lines(capsys)
    figures = {line["method"]: line["figures"] for line in of(found, "figures")}
    assert figures["final"]["mpjpe_mean"] == pytest.approx(0, abs=1e-3) and figures["phase 1"][
        "joint_error_mean"
    ] == pytest.approx(200, abs=1)
    assert [line["step"] for line in of(found, "progress")][-1:] == ["surfaces"]


def test_a_batch(capsys: pytest.CaptureFixture[str]):
    tasks: list[Any] = [SimpleNamespace(name="a"), SimpleNamespace(name="b")]
    outcome = partial(ClipOutcome, line=2, clip="", seconds=2.0)
    with json_lines(), closing(_Lines(2, tasks)) as shown:
        shown.show(1, Work(step="phase 1", share=0.25))
        shown.show(1, outcome(state="failed", reason="No keypoints."))
        shown.show(0, outcome(state="done", frames=3))
    first, second, third = (json.loads(line) for line in capsys.readouterr().out.splitlines())
    assert (first["event"], first["clip"], first["step"], first["share"]) == ("progress", "b", "phase 1", 0.25)
    assert (second["clip"], second["state"], second["reason"]) == ("b", "failed", "No keypoints.")
    assert (third["clip"], third["state"], third["place"], third["total"]) == ("a", "done", 2, 2)


def test_a_detection(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    spot = spots((160, 120), {0: (80.0, 60.0)}, sigma=4.0)[..., ::-1]
    video = write_film(tmp_path / "walk.avi", [spot] * 8)
    model = brightest_model(tmp_path / "pose.onnx", size=(96, 128))
    given = ["--detector", str(model), "--out", str(tmp_path / "kp"), "--threads", "1", "--json"]
    assert main(["detect", str(video), *given]) == 0
    found = lines(capsys)
    assert [line["step"] for line in of(found, "step")] == [line["step"] for line in of(found, "step_done")]
    assert of(found, "step")[0]["title"] == "Keypoints" and of(found, "progress")[-1]["share"] == 1
    assert of(found, "wrote")[0]["kind"] == "keypoints"


@pytest.mark.parametrize("given", [["fit", "--out", "x", "--json"], ["export", "--formats", "odd", "--json"]])
def test_what_cannot_be_done(given: list[str], capsys: pytest.CaptureFixture[str]):
    assert main(given) == 2
    found = lines(capsys)
    assert [line["event"] for line in found] == ["started", "error", "ended"]
    assert "expected" in found[1]["text"] and found[-1]["code"] == 2


def test_progress_never_falls_and_comes_by_hundredths(capsys: pytest.CaptureFixture[str]):
    with json_lines() as end:
        for share in (0.0, 0.001, 0.5, 0.2, 0.505, 0.51, 1.0):
            emit(StepProgress(step="a", share=share, text=""))
        emit(StepProgress(step="b", share=0.1, text=""))
        print("for people")
        end(0)
    told = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [line.get("share") for line in told] == [0.0, 0.5, 0.51, 1.0, 0.1, None]


def test_nothing_is_told_without_it(capsys: pytest.CaptureFixture[str]):
    emit(StepProgress(step="a", share=0.5, text=""))
    assert not capsys.readouterr().out


def test_a_reader_that_goes_away_ends_it():
    code = "import sys; from tcfit_app.cli.main import main; sys.exit(main(['export', '--formats', 'list', '--json']))"
    done = subprocess.run(
        ["bash", "-c", '"$0" -c "$1" | true; echo ${PIPESTATUS[0]}', sys.executable, code],
        capture_output=True,
        text=True,
        cwd=PAGE.parents[1],
    )
    assert done.stdout.strip() in ("0", "141") and "Exception ignored" not in done.stderr
    assert "Traceback" not in done.stderr
