"""`tcfit demo`: what it refuses before anything is read. The review of the demo is tested by test_newest.py."""

from pathlib import Path

import pytest

from tcfit_app.cli import demo_command
from tcfit_app.cli.main import main


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--out", "new", "--set", "solver=adam"], "expected one of lm"),
        (["--out", "."], "contains other files"),
        (["--no-review"], "was removed. Use tcfit demo, then tcfit evaluate tcfit-demo.tcfit."),
    ],
)
def test_wrong_options_are_refused_before_the_clip_is_read(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture, options: list[str], said: str
):
    def never(*_: object) -> None:
        raise AssertionError("the clip was read")

    monkeypatch.setattr(demo_command, "read_clip", never)
    monkeypatch.chdir(tmp_path)
    Path("mine").write_text("x")
    assert main(["demo", *options]) == 2 and said in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]
