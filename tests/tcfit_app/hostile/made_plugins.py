"""Plugins that do what no plugin should, made from a seed."""

from pathlib import Path

from tests.tcfit_app.hostile.made_files import Rng, one

_ACTS = (
    "raise SystemExit(7)", "raise SystemExit(0)", "raise SystemExit('bye')", "raise RecursionError('deep')",
    "raise MemoryError", "raise StopIteration",
    "raise OSError(28, 'No space left on device')", "raise ImportError('nothing')", "raise UnicodeError('x')",
    "raise KeyboardInterrupt", "raise type('Odd', (Exception,), {'__str__': lambda self: 1 / 0})()",
    "(lambda f: f(f))(lambda f: f(f))", "return None", "return 'x' * 10**6", "return float('nan')", "return 10**400",
    "return object()", "return [object()]", "return {}", "return lambda: None", "x = []; x.append(x); return x",
    "import numpy; return numpy.array([None, 'a'])", "import numpy; return numpy.full(9, numpy.nan)",
    "return (n for n in iter(int, 1) if 0 * n or __import__('sys').exit(3))",
    "print('x' * 10**5)", "import sys; sys.stdout.close()", "import sys; sys.stderr.close()", "import os; os.close(1)",
    "import os; os.close(2)", "import sys; sys.stdout = None", "import sys; sys.argv[:] = []",
    "import threading, time; threading.Thread(target=time.sleep, args=(2,)).start()",
    "import threading, time; threading.Thread(target=time.sleep, args=(99,), daemon=True).start()",
    "import sys; sys.setrecursionlimit(150)", "import os; os.environ.clear()", "import warnings; warnings.warn('odd')",
    "import logging; logging.disable(99)", "import os; os.chdir('/')",
)  # fmt: skip
"""What one does; then it returns what it was to return."""
_CODE = """
from pathlib import Path
import numpy as np
from tcfit_app.plugin_api import Detections, Export, KeypointReader

def act():
    {act}

def done(place, value):
    if place != {place!r}:
        return value
    found = act()
    return value if found is None and not {nothing} else found

def title(place):
    return done(place, "Odd")

def recognises(path, start):
    return done("recognises", path.suffix == ".odd")

def read(path):
    people = np.zeros((6, 1, 137, 3)) + 9
    return done("read", Detections(frames=tuple(people), stems=tuple(f"a_{{n:06d}}" for n in range(6)), source=path))

def write(source, path, progress):
    path.write_text("x")
    done("write", None)
    progress(done("progress", 1.0))

done("import", None)
READER = done("reader", KeypointReader(title=title("reader title"), recognises=recognises, read=read))
EXPORT = done("export", Export(title="Odd", group="Python", suffix=done("suffix", ".odd.csv"), hint="", write=write))
"""
_POINTS = {"readers": "READER", "exports": "EXPORT"}
_LINES = {
    "readers": ["new", "walk.mp4", "--keypoints", "points.odd", "--out", "new.tcfit"],
    "exports": ["export", "walk.tcfit", "--formats", "odd", "--out", "new"],
}
_PLACES = {
    "readers": ("import", "reader", "reader title", "recognises", "read"),
    "exports": ("import", "export", "suffix", "write", "progress"),
}


def plugins(rng: Rng, packages: Path) -> list[str]:
    """Installs one; the command line that uses it."""
    group = one(rng, ("readers", "exports"))
    place, act = one(rng, _PLACES[group]), one(rng, _ACTS)
    about = packages / "odd-0.1.dist-info"
    about.mkdir(exist_ok=True)
    (packages / "odd.py").write_text(_CODE.format(act=act, place=place, nothing=act == "return None"))
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: odd\nVersion: 0.1\n")
    (about / "entry_points.txt").write_text(f"[tcfit.{group}]\nodd = odd:{_POINTS[group]}\n")
    return [*_LINES[group]]
