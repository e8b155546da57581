"""Calls of `tcfit`, each in a process of its own that may hang, crash or be killed; and how each ended.

A process that has loaded everything waits for command lines and forks for each: a call takes a tenth of a second.
"""

import json
import os
import resource
import select
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

_GOES_ON = "http://127.0.0.1:"
"""What is printed by an app that is open until it is stopped."""
LIMIT = 20.0
"""Seconds after which a call hangs."""
_GLANCE, _OPEN_FOR = 0.1, 5.0
"""Seconds between two looks at a call, and for which an app is left open."""
_STREAMS = ("out", "err")
"""Files of what a call prints."""
MOST_MEMORY = 1.0
"""GB that a call may take beyond what has been loaded."""
UPLOAD = "upload"
"""Stands for a command that imports a file as a browser uploads it: project and file."""
_MOST_SPACE = 16 * 2**30
_LOADED = (
    "torch", "cv2", "fitting_core.fit.fitting", "fitting_core.clips.reading", "fitting_core.measure.report",
    "tcfit_app.cli.fit_command", "tcfit_app.cli.export_command", "tcfit_app.cli.import_command",
    "tcfit_app.cli.evaluate_command", "tcfit_app.cli.batch_command", "tcfit_app.cli.new_command",
    "tcfit_app.cli.review_command", "tcfit_app.cli.detect_command", "tcfit_app.cli.models_command",
)  # fmt: skip
"""What calls need."""


@dataclass(frozen=True, kw_only=True)
class Ended:
    """How a call ended."""

    arguments: tuple[str, ...]
    status: int
    """Of the process; negative: the signal that ended it."""
    out: str
    err: str
    hung: bool
    seconds: float
    """Of a processor: what others do on this computer does not count."""
    memory: float
    """GB that the call took, at most at one time."""

    @property
    def fault(self) -> str:
        """What is wrong with such an end, whatever the call was; empty if nothing is."""
        if self.hung:
            return "" if _GOES_ON in self.out + self.err else "hangs"
        if self.status < 0:
            return f"ends by signal {-self.status}"
        if "Traceback" in self.err or "Exception ignored" in self.err:
            return "shows a traceback"
        if self.status not in (0, 1, 2, 130, 141):
            return f"ends with status {self.status}"
        if self.status == 2 and not self.err.strip():
            return "says nothing about what is wrong"
        return f"takes {self.memory:.1f} GB" if self.memory > MOST_MEMORY else ""


class Calls:
    """Runs calls, one at a time."""

    def __init__(self, process: "subprocess.Popen[bytes]", folder: Path) -> None:
        self._process, self._folder = process, folder

    def __call__(self, arguments: Sequence[str], *, limit: float = LIMIT) -> Ended:
        """Run `tcfit` with these arguments, in the folder of all calls."""
        assert self._process.stdin and self._process.stdout
        self._process.stdin.write(json.dumps([list(arguments), limit]).encode() + b"\n")
        self._process.stdin.flush()
        status, hung, seconds, memory = json.loads(self._process.stdout.readline())
        out, err = (self._folder / name for name in _STREAMS)
        return Ended(
            arguments=tuple(arguments),
            status=status,
            out=out.read_bytes().decode("utf-8", "replace"),
            err=err.read_bytes().decode("utf-8", "replace"),
            hung=hung,
            seconds=seconds,
            memory=memory,
        )


@contextmanager
def calls(folder: Path, working: Path, *, packages: Path | None = None) -> Iterator[Calls]:
    """A process that runs calls.

    Args:
        folder: New; for what calls print.
        working: Where they run.
        packages: Where further packages may be installed while it runs.
    """
    folder.mkdir()
    command = [sys.executable, "-m", "tests.tcfit_app.hostile.calls", str(folder), str(working)]
    root = str(Path(__file__).parents[3])
    paths = root if packages is None else os.pathsep.join((root, str(packages)))
    environment = {**os.environ, "PYTHONPATH": paths, "OMP_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}
    environment |= {"XDG_DATA_HOME": str(folder / "data")}
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment, cwd=root)
    try:
        yield Calls(process, folder)
    finally:
        process.kill()
        process.wait()


def _serve(folder: Path, working: Path) -> None:
    for name in _LOADED:
        __import__(name)
    os.chdir(working)
    for line in sys.stdin.buffer:
        arguments, limit = json.loads(line)
        print(json.dumps(_forked(arguments, limit, folder)), flush=True)


def _forked(arguments: list[str], limit: float, folder: Path) -> tuple[int, bool, float, float]:
    hung = False
    child = os.fork()
    if child == 0:
        _become(arguments, folder)
    handle = os.pidfd_open(child)
    last = time.monotonic() + limit
    while not select.select([handle], [], [], _GLANCE)[0]:
        if _goes_on(folder):
            last = min(last, time.monotonic() + _OPEN_FOR)
        if time.monotonic() > last:
            hung = True
            os.killpg(child, signal.SIGKILL)
            break
    os.close(handle)
    _, status, used = os.wait4(child, 0)
    memory = max(used.ru_maxrss - _resident(), 0) / 2**20
    return os.waitstatus_to_exitcode(status), hung, used.ru_utime + used.ru_stime, memory


def _goes_on(folder: Path) -> bool:
    return any(_GOES_ON.encode() in (folder / name).read_bytes() for name in _STREAMS)


def _resident() -> int:
    """Kilobytes of this process, with which a forked one begins."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") // 2**10


def _become(arguments: list[str], folder: Path) -> None:
    """Be `tcfit` from here on."""
    os.setpgid(0, 0)
    for descriptor, name in enumerate(_STREAMS, start=1):
        target = os.open(folder / name, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(target, descriptor)
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    sys.stdin, sys.stdout, sys.stderr = (os.fdopen(i, "r" if i == 0 else "w", closefd=False) for i in range(3))
    sys.stderr.reconfigure(errors="backslashreplace")  # as Python has it
    status = 70
    space = resource.getrlimit(resource.RLIMIT_AS)[1]
    resource.setrlimit(resource.RLIMIT_AS, (_MOST_SPACE, space))  # so that no fault takes the whole computer
    try:
        from tcfit_app.cli.main import main

        status = _uploaded(*arguments[1:]) if arguments[:1] == [UPLOAD] else main(arguments)
    except BaseException as error:
        sys.excepthook(type(error), error, error.__traceback__)
        status = 1
    finally:
        for stream in (sys.stdout, sys.stderr):
            with suppress(ValueError, AttributeError):  # a plugin has closed it, or put something else in its place
                stream.flush()
        os._exit(status)


def _uploaded(project: str, file: str) -> int:
    from tcfit_app.cli.ending import ended
    from tcfit_app.fitting.bodies import Bodies
    from tcfit_app.imports.results import import_run
    from tcfit_app.imports.uploads import upload
    from tcfit_app.project.project import Project

    def take() -> None:
        path = Path(file)
        with Project.open(Path(project)) as opened, upload(path.name, path.read_bytes()) as kept:
            import_run(opened, Bodies(), kept, source=path.name)

    return ended(take)


if __name__ == "__main__":
    _serve(Path(sys.argv[1]), Path(sys.argv[2]))
