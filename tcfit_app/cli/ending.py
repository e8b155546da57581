"""The end of a command: an exit code, and at most one line for the user."""

import io
import os
import sys
from collections.abc import Callable

from fitting_core.errors import InputError
from fitting_core.files.regular import legible
from tcfit_app.cli.json_lines import Failure, discard, emit

FAILED, INPUT_ERROR, CANCELLED, PIPE_CLOSED = 1, 2, 130, 141
"""Exit codes: failure such as a full disk; wrong input, as for unknown options; Ctrl-C (128 + SIGINT, as in shells); a
closed pipe, as after `head` (128 + SIGPIPE)."""
_NO_ROOM = ("failed to map segment", "cannot allocate memory")
"""Messages of the system's loader if memory is short."""
_ROOM = "tcfit needs 1.5 GB: close other programs, or raise the limit (ulimit -v)."


def prepare_streams() -> None:
    """Ensure that all three standard streams exist and that none fails for a character that its encoding lacks.

    A stream that was closed at the start is replaced by an empty one. Otherwise the next opened file would get its
    descriptor, and messages would be written into that file.
    """
    for descriptor in range(3):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # gets the lowest free number, which is this one
    sys.stdin = sys.stdin or open(0, closefd=False)  # noqa: SIM115
    sys.stdout = sys.stdout or open(1, "w", closefd=False)  # noqa: SIM115
    sys.stderr = sys.stderr or open(2, "w", closefd=False)  # noqa: SIM115
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")


def ended(run: Callable[[], int | None]) -> int:
    """Run a command and return its exit code."""
    try:
        code = _told(run)
        _reopened()
        sys.stdout.flush()
        sys.stderr.flush()
        return code
    except BrokenPipeError:
        _drop_output()
        return PIPE_CLOSED
    except OSError as error:  # the message about it may fail too
        _drop_output()
        return _say_at_last(f"the output cannot be written: {_reason(error)}.")


def _told(run: Callable[[], int | None]) -> int:
    try:
        return run() or 0
    except SystemExit as end:
        return int(end.code or 0)
    except InputError as error:
        return _say(str(error), INPUT_ERROR)
    except KeyboardInterrupt:
        return _say("cancelled.", CANCELLED)
    except BrokenPipeError:
        raise
    except MemoryError as error:
        return _say(f"there is not enough memory ({_first_line(error)}). Close other programs, or take fewer frames.")
    except ImportError as error:
        if not any(words in str(error).lower() for words in _NO_ROOM):
            raise
        return _say(f"there is not enough memory to load a library ({_first_line(error)}). {_ROOM}")
    except OverflowError as error:
        return _say(f"a number is too large ({_first_line(error)}). Check the options.")
    except UnicodeEncodeError:
        return _say("a name is not UTF-8. Rename the file or folder.", INPUT_ERROR)
    except OSError as error:
        return _say(_of_system(error))
    except ValueError:
        if not _reopened():
            raise
        return _say("a plugin closed standard output, so some output is missing. Uninstall the plugin.")


def _reopened() -> bool:
    """Whether a plugin closed or removed a standard stream; it is opened again."""
    gone = [name for name in ("stdout", "stderr") if (stream := getattr(sys, name)) is None or stream.closed]
    for name in gone:
        setattr(sys, name, open(1 if name == "stdout" else 2, "w", closefd=False))  # noqa: SIM115
    return bool(gone)


def _of_system(error: OSError) -> str:
    try:
        os.getcwd()
    except FileNotFoundError:
        return "the current folder no longer exists. Change to another."
    where = "" if error.filename is None else f"{legible(os.fsdecode(error.filename))}: "
    return f"{where}{_reason(error)}."


def _reason(error: OSError) -> str:
    return (error.strerror or _first_line(error)).rstrip(".")


def _first_line(error: BaseException) -> str:
    return next(iter(str(error).splitlines()), "") or type(error).__name__


def _say(text: str, code: int = FAILED) -> int:
    _reopened()
    emit(Failure(text=text))
    print(f"tcfit: {text}", file=sys.stderr, flush=True)
    return code


def _say_at_last(text: str) -> int:
    """As _say, but standard error itself may fail."""
    try:
        return _say(text)
    except OSError:
        return FAILED


def _drop_output() -> None:
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:
            discard(stream)
