"""The page about a batch: its order, its pictures, what opens a result, and ten thousand rows in a browser."""

import json
import multiprocessing
import re
import shlex
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
import pytest

from fitting_core.body.model import BodyModel
from fitting_core.config.schema import FitConfig
from fitting_core.errors import InputError
from tcfit_app.batch import report
from tcfit_app.batch.fingerprint import Fingerprint
from tcfit_app.batch.manifest import ClipTask
from tcfit_app.batch.outcome import row_of
from tcfit_app.batch.pictures import SIZE, suspects, write_picture
from tcfit_app.batch.records import Figures, Record, picture_path
from tcfit_app.batch.report import served_report, write_report
from tcfit_app.cli.main import main
from tcfit_app.fitting import child_processes
from tcfit_app.options.fit import FitOptions
from tcfit_app.project.project import Project
from tests.drivers.processes import needs_fork
from tests.samples.batch_clips import CHEAP, events, write_batch
from tests.samples.waving import waving_fit, waving_project

if TYPE_CHECKING:
    from playwright.sync_api import Browser

NO_FILES = Fingerprint(settings="", stamp="", content="")


def task(folder: Path, name: str, **more: Any) -> ClipTask:
    fit = FitOptions(out=folder / name, keypoints=folder / f"keys of {name}")
    return ClipTask(line=2, name=name, fit=fit, config=FitConfig(), **more)


def done(**figures: Any) -> Record:
    known = Figures(**({"frames": 10, "reprojection_px": 2.0, "jitter_mm": 3.0, "suspicious": 1} | figures))
    return Record(state="done", fingerprint=NO_FILES, finished=0.0, seconds=2.0, figures=known)


def failed(reason: str) -> Record:
    return Record(state="failed", fingerprint=NO_FILES, finished=0.0, seconds=0.1, reason=reason)


def page_of(folder: Path, found: dict[str, Record | None], **more: Any) -> Path:
    batch = folder / "clips.batch"
    batch.mkdir(exist_ok=True)
    tasks = [task(folder, name, **more) for name in found]
    rows = [row_of(t, record, False) for t, record in zip(tasks, found.values(), strict=True)]
    return write_report(batch, "clips.csv", tasks, rows, list(found.values()))


def rows_of(page: Path) -> list[dict[str, Any]]:
    text = page.read_text(encoding="utf-8")
    found = re.search(r'<script type="application/json" id="rows">(.*?)</script>', text, re.S)
    assert found
    return json.loads(found[1])


def test_the_worst_come_first(tmp_path: Path):
    clips = {
        "fine": done(),
        "left": None,
        "jittery": done(jitter_mm=30.0),
        "far off": done(reprojection_px=9.0),
        "doubted": done(doubts=("the body is 300 m from the camera",)),
        "suspicious": done(suspicious=40, worst="frame 3: left wrist is 42 px off"),
        "broken": failed("</script><b>no keypoints"),
        "blind": done(reprojection_px=None, jitter_mm=None, suspicious=None),
    }
    page = page_of(tmp_path, clips)
    rows = rows_of(page)
    order = ["broken", "doubted", "suspicious", "jittery", "far off", "fine", "blind", "left"]
    assert [row["clip"] for row in rows] == order
    assert rows[0]["why"] == "</script><b>no keypoints" and "command" not in rows[0]
    assert rows[1]["why"].startswith("the body is 300 m") and rows[2]["why"] == "frame 3: left wrist is 42 px off"
    assert rows[1]["href"] == "../doubted" and "px" not in rows[6]


def test_a_batch_of_failures_alone_has_a_page(tmp_path: Path):
    assert [row["state"] for row in rows_of(page_of(tmp_path, {"a": failed("no"), "b": None}))] == ["failed", "left"]


def test_the_command_opens_the_result(tmp_path: Path):
    (row,) = rows_of(page_of(tmp_path, {"it's a clip": done()}))
    assert shlex.split(row["command"]) == ["tcfit", "review", str(tmp_path / "it's a clip")]


def test_served_by_a_site_its_rows_lead_there_and_its_scripts_stay_out(tmp_path: Path):
    page = page_of(tmp_path, {"a": done(), "b": failed("<b>no</b>")})
    text = page.read_text(encoding="utf-8").replace("</body>", "<script>steal()</script></body>")
    evil = text.replace('"href":"../a"', '"href":"javascript:steal()","picture":"http://example.org/x.jpg"')
    for written, href in ((text, "/#0123"), (evil, None)):
        page.write_text(written, encoding="utf-8")
        served = served_report(page, {"../a": "/#0123"})
        assert "steal" not in served and "example.org" not in served
        page.write_text(served, encoding="utf-8")
        rows = {row["clip"]: row for row in rows_of(page)}
        assert rows["a"].get("href") == href and "command" not in rows["a"] and rows["b"]["why"] == "<b>no</b>"
    page.write_text("<p>Another page", encoding="utf-8")
    with pytest.raises(InputError, match="expected the report"):
        served_report(page, {})


def test_pictures_of_the_worst_are_within_the_page_and_others_beside_it(tmp_path: Path, monkeypatch):
    monkeypatch.setattr(report, "_WITHIN", 1)
    (tmp_path / "clips.batch" / "pictures").mkdir(parents=True)
    for name in ("a", "b"):
        picture_path(tmp_path / "clips.batch", task(tmp_path, name)).write_bytes(b"JPEG")
    worst, other = rows_of(page_of(tmp_path, {"a": done(), "b": done(jitter_mm=9.0)}))
    assert worst["picture"] == "data:image/jpeg;base64,SlBFRw=="
    assert (tmp_path / "clips.batch" / other["picture"]).read_bytes() == b"JPEG"


def test_a_picture_shows_the_body_where_the_person_is(tmp_path: Path, free_body: BodyModel):
    waving_project(tmp_path / "p.tcfit", free_body)
    with Project.open(tmp_path / "p.tcfit") as project:
        clip = project.clip
    fit = waving_fit(0.0)
    images, size = tmp_path / "images", clip.camera.size
    images.mkdir()
    for number in range(clip.first_frame + len(clip)):
        cv2.imwrite(str(images / f"{number}.png"), np.full((size[1], size[0], 3), 40, np.uint8))
    for name, source in (("plain", None), ("seen", images)):
        write_picture(tmp_path / f"{name}.jpg", fit, replace(clip, source=source), free_body, frame=2)
    plain, seen = (cv2.imread(str(tmp_path / f"{name}.jpg")) for name in ("plain", "seen"))
    assert plain is not None and seen is not None and plain.shape == (SIZE[1], SIZE[0], 3)
    blue = plain[..., 0].astype(int) - plain[..., 2] > 30
    assert 0.05 < blue.mean() < 0.6 and blue[40:80, 30:66].mean() > 2 * blue[:, [0, -1]].mean()
    assert (tmp_path / "plain.jpg").stat().st_size < 6000 and np.abs(plain.astype(int) - seen).mean() > 5
    assert isinstance(suspects(fit, clip, free_body), tuple)


@needs_fork
def test_a_batch_writes_its_report_and_tells_how_it_stands(
    tmp_path: Path, free_body: BodyModel, monkeypatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setattr(child_processes, "CONTEXT", multiprocessing.get_context("fork"))
    command = ["batch", str(write_batch(tmp_path, free_body, clips=3, broken=1)), *CHEAP, "--jobs", "1"]
    page = tmp_path / "clips.batch" / "report.html"
    assert main([*command, "--report"]) == 0 and [row["state"] for row in rows_of(page)] == ["left"] * 3
    assert main(command) == 1
    rows = rows_of(page)
    assert rows[0]["clip"] == "fits/c001" and all("suspicious" in row for row in rows[1:])
    assert all(row["picture"].startswith("data:image/jpeg;base64,/9j/") for row in rows[1:])
    assert (page.parent / rows[1]["href"] / "fit.npz").exists()
    fitted = len(list(events(tmp_path, "started")))
    page.unlink()
    capsys.readouterr()
    assert main([*command, "--report", "--retry"]) == 1
    assert [row["state"] for row in rows_of(page)] == ["failed before", "done before", "done before"]
    assert len(list(events(tmp_path, "started"))) == fitted and "report.html" in capsys.readouterr().out


def test_ten_thousand_rows_are_sorted_and_searched_in_a_browser(tmp_path: Path, browser: "Browser"):
    clips: dict[str, Record | None] = {f"c{i:05}": done(jitter_mm=1.0 + i % 977) for i in range(10_000)}
    path = page_of(tmp_path, clips | {"broken <i>": failed("no keypoints")})
    assert path.stat().st_size < 10e6
    page = browser.new_page()
    faults: list[object] = []
    page.on("pageerror", lambda fault: faults.append(fault))
    page.goto(path.as_uri())
    rows = page.locator("#clips tbody tr")
    assert rows.count() <= 300 and "broken <i>" in rows.first.inner_text()
    page.get_by_role("button", name="clip", exact=True).click()
    assert "broken <i>" in rows.first.inner_text()
    page.get_by_role("button", name="clip", exact=True).click()
    assert "c09999" in rows.first.inner_text()
    page.get_by_role("searchbox").fill("c0007")
    assert rows.count() == 10 and "10 of 10001 clips" in page.locator(".tools").inner_text()
    page.get_by_role("searchbox").fill("")
    page.get_by_label("State").select_option("failed")
    assert rows.count() == 1
    page.get_by_label("State").select_option("")
    page.mouse.wheel(0, 20_000)
    page.wait_for_function("document.querySelectorAll('#clips tbody tr').length > 100")
    assert not faults
    page.close()
