"""Commands as processes of their own, whose standard streams are closed, full, gone or of an old encoding."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from tcfit_app.cli.ending import CANCELLED, FAILED, INPUT_ERROR, PIPE_CLOSED, ended
from tcfit_app.cli.main import COMMANDS, main

pytestmark = pytest.mark.thorough

TCFIT = f'"{sys.executable}" -m tcfit_app'
QUICK = {"settings": "settings", "a mistake": "fit"}
"""What ends by itself at once: one that prints much, and one that only complains."""
AROUND = {
    "reader gone": "{command} | exec 0<&-",
    "output full": "{command} > /dev/full",
    "errors full": "{command} 2> /dev/full",
    "output closed": "{command} >&-",
    "errors closed": "{command} 2>&-",
    "input closed": "{command} <&-",
    "all closed": "{command} <&- >&- 2>&-",
    "ASCII": "PYTHONIOENCODING=ascii {command}",
    "cp1251": "PYTHONIOENCODING=cp1251 {command}",
}


def shell(line: str, folder: Path) -> subprocess.CompletedProcess[bytes]:
    """Run in bash; the exit code is that of the first command of a pipe."""
    code = f"{line}; exit ${{PIPESTATUS[0]}}"
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    return subprocess.run(["bash", "-c", code], capture_output=True, cwd=folder, env=environment, timeout=60)


@pytest.mark.parametrize("around", AROUND)
@pytest.mark.parametrize("command", QUICK)
def test_no_traceback_around(command: str, around: str, tmp_path: Path):
    done = shell(AROUND[around].format(command=f"{TCFIT} {QUICK[command]}"), tmp_path)
    assert b"Traceback" not in done.stderr and b"Exception ignored" not in done.stderr
    assert done.returncode in (0, FAILED, INPUT_ERROR, PIPE_CLOSED)
    if "full" not in around and "gone" not in around:
        assert done.returncode == (INPUT_ERROR if command == "a mistake" else 0)


@pytest.mark.slow
@pytest.mark.parametrize("around", AROUND)
@pytest.mark.parametrize("command", COMMANDS)
def test_no_traceback_of_any_help_and_any_mistake(command: str, around: str, tmp_path: Path):
    for options in ("--help", "--nonsense"):
        done = shell(AROUND[around].format(command=f"{TCFIT} {command} {options}"), tmp_path)
        assert b"Traceback" not in done.stderr and b"Exception ignored" not in done.stderr
        assert done.returncode in (0, FAILED, INPUT_ERROR, PIPE_CLOSED)


def test_a_reader_that_goes_ends_it_in_silence(tmp_path: Path):
    # On a busy machine the reader is gone only after a while.
    done = shell(f"(sleep 1; exec {TCFIT} settings) | exec 0<&-", tmp_path)
    assert (done.returncode, done.stderr) == (PIPE_CLOSED, b"")


def test_a_full_device_is_told_in_a_line(tmp_path: Path):
    done = shell(f"{TCFIT} settings > /dev/full", tmp_path)
    assert done.returncode == FAILED
    assert done.stderr.startswith(b"tcfit: ") and b"No space left on device" in done.stderr
    assert done.stderr.count(b"\n") == 1


def test_a_file_never_takes_the_place_of_a_closed_stream(tmp_path: Path):
    """Whatever is told afterwards would be written into it."""
    code = "from tcfit_app.cli.ending import prepare_streams; prepare_streams(); print(open('/dev/null').fileno() > 2)"
    assert shell(f'"{sys.executable}" -c "{code}" 2>&- <&-', tmp_path).stdout == b"True\n"


def test_signs_that_an_encoding_lacks(tmp_path: Path):
    code = "from tcfit_app.cli.ending import prepare_streams; prepare_streams(); print('mm/frame\\u00b2', '\\udce4')"
    done = shell(f'PYTHONIOENCODING=ascii "{sys.executable}" -c "{code}"', tmp_path)
    assert (done.returncode, done.stdout) == (0, b"mm/frame? ?\n")


def test_a_folder_that_is_gone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]):
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    assert main(["fit", "--out", "x"]) == FAILED
    assert "the current folder no longer exists" in capsys.readouterr().err


def _raising(error: BaseException) -> Callable[[], None]:
    def run() -> None:
        raise error

    return run


@pytest.mark.parametrize(
    "error, code, told",
    [
        (OSError(28, "No space left on device", "a/b.npz"), FAILED, "a/b.npz: No space left on device."),
        (OSError("torn"), FAILED, "torn."),
        (MemoryError("Unable to allocate 5 TiB"), FAILED, "not enough memory (Unable to allocate 5 TiB)"),
        (MemoryError(), FAILED, "not enough memory (MemoryError)"),
        (ImportError("libavcodec.so: failed to map segment from shared object"), FAILED, "tcfit needs 1.5 GB"),
        (ImportError("x.so: cannot allocate memory in static TLS block"), FAILED, "to load a library (x.so: cannot"),
        (OverflowError("int too large"), FAILED, "a number is too large (int too large)"),
        (UnicodeEncodeError("utf-8", "\udce4", 0, 1, "surrogates"), INPUT_ERROR, "not UTF-8"),
        (KeyboardInterrupt(), CANCELLED, "cancelled."),
        (BrokenPipeError(), PIPE_CLOSED, ""),
        (SystemExit(3), 3, ""),
    ],
)
def test_every_end_is_a_code_and_a_line(error: BaseException, code: int, told: str, capsys: pytest.CaptureFixture[str]):
    assert ended(_raising(error)) == code
    err = capsys.readouterr().err
    assert told in err and err.count("\n") == (1 if told else 0)


def test_a_fault_of_ours_is_not_hidden():
    with pytest.raises(AssertionError):
        ended(_raising(AssertionError()))


@pytest.mark.parametrize("name", [300 * "x", "a\0b", 5000 * "x", os.fsdecode(b"w\xe4lk")])
def test_an_out_that_cannot_be_is_refused_before_anything_is_read(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    os.mkfifo(tmp_path / "keypoints.json")
    assert main(["fit", "--keypoints", str(tmp_path / "keypoints.json"), "--out", name]) == INPUT_ERROR
    err = capsys.readouterr().err
    assert err.startswith("tcfit: ") and err.count("\n") == 1 and "keypoints.json" not in err


@pytest.mark.parametrize("given, told", [("1e300", "1e+300; expected 0 or more, at most 1e+12"), ("nan", "is nan")])
def test_a_weight_has_a_range(given: str, told: str, capsys: pytest.CaptureFixture[str]):
    assert main(["settings", "--temporal-weight", given]) == INPUT_ERROR
    assert told in capsys.readouterr().err
