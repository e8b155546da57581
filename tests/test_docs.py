"""README and documentation: short where it must be, every link leads somewhere, and every command and example works."""

import ast
import importlib
import io
import re
import runpy
import shlex
import sys
from collections.abc import Iterator
from contextlib import redirect_stdout
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fitting_core
from fitting_core.config.schema import PRESETS, SolverSettings
from fitting_core.detect.detectors import DETECTORS
from fitting_core.io.keypoints.openpose import write_openpose
from fitting_core.keypoints import Keypoints
from fitting_core.measure.references.bodies import reference_of
from fitting_core.measure.references.reference import write_reference
from tcfit_app.cli.main import parse
from tests.samples.fake_detector import FakeDetector, known, one_person
from tests.samples.media import write_film
from tests.samples.posed_clips import CAMERA, clip_of, motion, shipped_body

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = sorted(DOCS.rglob("*.md"))
TEXTS = [*(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")), *PAGES]
CURRENT = [path for path in TEXTS if path.name != "CHANGELOG.md"]
"""What they name exists; the changelog also names what was removed."""
BYTES_OF_README = 8000

_SOURCES = {".py", ".js", ".ts", ".css", ".md"}
_LINK = re.compile(r"!?\[[^\]]*\]\(([^)\s]+)\)")
_HEADING = re.compile(r"^#+ +(.*)$", re.MULTILINE)
_FENCED = re.compile(r"^```(\w*)\n(.*?)^```", re.MULTILINE | re.DOTALL)
_SPAN = re.compile(r"`([^`\n]+)`")
_OPTION = re.compile(r"(?<![\w-])--[a-z][a-z0-9_-]*")
_FOREIGN = {"--video", "--write_json", "--hand", "--face", "--keypoint_scale", "--file"}
"""Options of OpenPose and Docker, which are not ours."""
QUICK = replace(
    PRESETS["tcfit"],
    relay_rounds=0,
    yaws="side_view",
    limb_flips=False,
    settings=SolverSettings(iterations=3),
)
"""For examples, which show how to call, and not how good the fit is."""


def name_of(path: Path) -> str:
    """As pytest shows it."""
    return path.relative_to(ROOT).as_posix()


def text_of(path: Path) -> str:
    return path.read_text(encoding="utf-8")


def indented(text: str) -> Iterator[str]:
    """The lines of command that a page shows, continued ones joined, without their indentation."""
    joined = _FENCED.sub("", text).replace("\\\n", " ")
    return (line.strip() for line in joined.splitlines() if line.startswith("    "))


def words(line: str) -> list[str]:
    """A line of a shell, without its comment and without where its output goes."""
    found = shlex.split(line, comments=True)
    return found[: found.index(">")] if ">" in found else found


def shown(program: str) -> list[tuple[str, ...]]:
    """The arguments of each command line of a program in the pages' blocks."""
    texts = map(text_of, CURRENT)
    lines = (line.removeprefix(".venv/bin/") for text in texts for line in indented(text))
    return [tuple(words(line.removeprefix(program))) for line in lines if line.startswith(program + " ")]


def spans() -> Iterator[tuple[str, str]]:
    """Page and content of each span of code in running text."""
    for path in CURRENT:
        text = _FENCED.sub("", text_of(path))
        running = "\n".join(line for line in text.splitlines() if not line.startswith("    "))
        yield from ((name_of(path), span) for span in _SPAN.findall(running))


# --- size and links ---


def test_the_readme_is_short():
    assert len((ROOT / "README.md").read_bytes()) <= BYTES_OF_README


def anchors(page: Path) -> set[str]:
    """What a link into a page can name: its headings, as GitHub and mkdocs write them."""
    headings = _HEADING.findall(_FENCED.sub("", text_of(page)))
    plain = (re.sub(r"[^\w\s-]", "", heading).strip().lower() for heading in headings)
    return {re.sub(r"\s+", "-", heading) for heading in plain}


@pytest.mark.parametrize("page", TEXTS, ids=name_of)
def test_every_relative_link_leads_somewhere(page: Path):
    for link in _LINK.findall(text_of(page)):
        if re.match(r"[a-z]+:", link):
            continue
        path, _, anchor = link.partition("#")
        target = (page.parent / path).resolve() if path else page
        assert target.is_file(), f"{link}: is not there"
        assert not anchor or anchor in anchors(target), f"{link}: no such heading"


def test_the_site_s_navigation_has_every_page():
    named = re.findall(r"^ +- .+: (\S+\.md)$", (ROOT / "mkdocs.yml").read_text(), re.MULTILINE)
    assert sorted(named) == sorted(page.relative_to(DOCS).as_posix() for page in PAGES)


def test_every_picture_is_shown():
    shown = {(page.parent / link).resolve() for page in TEXTS for link in _LINK.findall(text_of(page))}
    assert set((DOCS / "images").iterdir()) <= shown


@pytest.mark.parametrize("page", [ROOT / "README.md", DOCS / "index.md"], ids=name_of)
def test_the_version_of_torch_that_is_named_is_the_tested_one(page: Path):
    named = re.findall(r"PyTorch (\d+\.\d+\.\d+)", text_of(page))
    assert named and all(f"\ntorch=={version}\n" in text_of(ROOT / "constraints.txt") for version in named)


@cache
def docstrings() -> list[tuple[str, str]]:
    """Each file of the packages with each of its docstrings."""
    found: list[tuple[str, str]] = []
    for package in ("fitting_core", "tcfit_app", "benchmarks", "build_assets", "web_tools"):
        for path in sorted((ROOT / package).rglob("*.py")):
            nodes = ast.walk(ast.parse(text_of(path)))
            texts = (
                node.value for node in nodes if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
            )
            found += ((name_of(path), str(text.value)) for text in texts)
    return found


_FILE = re.compile(r"(?<![\w./~-])((?:[\w-]+/)+[\w-]+\.(?:py|js|ts|css|md))(?![\w/])")
_MODULE = re.compile(r"(?<![\w./])(?:fitting_core|tcfit_app|benchmarks|build_assets|web_tools|tests)(?:\.\w+)+")
_CITING = "fitting_core/io/motion/learned/", "fitting_core/files/torch_pickles.py"
"""They name the files of other projects that document a format."""


def test_every_file_that_is_named_exists():
    """By the end of its path."""
    tops = [path for path in ROOT.iterdir() if path.is_dir() and path.name[0] != "."]
    files = [path.relative_to(ROOT) for top in tops for path in top.rglob("*") if path.suffix in _SOURCES]
    ours = [path.parts for path in files if "node_modules" not in path.parts]
    there = {"/".join(parts[i:]) for parts in ours for i in range(len(parts))}
    named = [(name_of(page), text_of(page)) for page in CURRENT]
    named += [(name, text) for name, text in docstrings() if not name.startswith(_CITING)]
    found = {(name, path) for name, text in named for path in _FILE.findall(text)}
    assert len(found) > 50
    assert not {(name, path) for name, path in found if path not in there}


def exists(dotted: str) -> bool:
    """Whether this is a module or package, or a name in one."""
    *parents, name = dotted.split(".")
    place = ROOT.joinpath(*parents, name)
    if place.is_dir() or place.with_suffix(".py").is_file():
        return True
    return any(
        path.is_file() and re.search(rf"\b{name}\b", text_of(path))
        for path in (ROOT.joinpath(*parents).with_suffix(".py"), ROOT.joinpath(*parents, "__init__.py"))
    )


def test_every_module_that_is_named_exists():
    named = [(name_of(page), text_of(page)) for page in CURRENT]
    found = {(name, dotted) for name, text in [*named, *docstrings()] for dotted in _MODULE.findall(text)}
    assert len(found) > 30
    known = {"benchmarks.NAME", "fitting_core.assets"}  # any of them; mapped by setup.py
    assert not {(name, dotted) for name, dotted in found if dotted not in known and not exists(dotted)}


# --- commands ---


@cache
def help_of(*command: str) -> str:
    """What a command prints for --help."""
    with redirect_stdout(io.StringIO()) as printed, pytest.raises(SystemExit) as end:
        parse([*command, "--help"])
    assert not end.value.code, f"tcfit {' '.join(command)}: there is no such command"
    return printed.getvalue()


def subcommands() -> list[str]:
    """All that tcfit can do."""
    return re.findall(r"\{([a-z,]+)\}", help_of())[0].split(",")


@cache
def help_of_benchmark(name: str, *rest: str) -> str:
    """What `python -m NAME [COMMAND] --help` prints, of a whole command line."""
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(io.StringIO()) as printed:
        patch.setattr(sys, "argv", [name, *(rest[:1] if name == "evaluation" else ()), "--help"])
        patch.delitem(sys.modules, name, raising=False)
        with pytest.raises(SystemExit) as end:
            runpy.run_module(name, run_name="__main__", alter_sys=True)
    assert not end.value.code, name
    return printed.getvalue()


@pytest.mark.parametrize("arguments", sorted(set(shown("tcfit"))), ids=" ".join)
def test_a_command_line_can_be_read(arguments: tuple[str, ...], capsys: pytest.CaptureFixture):
    try:
        parse(arguments)
    except SystemExit:
        pytest.fail(capsys.readouterr().err)


def test_a_command_in_running_text_exists():
    for _, span in spans():
        found = span.split()
        if found[0] == "tcfit" and found[1:] and found[1] != "COMMAND" and not found[1].startswith("--"):
            assert found[1] in subcommands(), span


def benchmarks() -> list[tuple[str, ...]]:
    """Modules and arguments of benchmarks' command lines, in blocks and in running text."""
    inline = {
        tuple(shlex.split(span)[2:])
        for _, span in spans()
        if span.startswith(("python -m benchmarks", "python -m tests.flows"))
    }
    return sorted(line for line in {*shown("python -m"), *inline} if line[0] != "benchmarks.NAME")


@pytest.mark.parametrize("arguments", benchmarks(), ids=" ".join)
def test_a_benchmark_has_the_options_that_are_shown(arguments: tuple[str, ...]):
    given = {word for word in arguments if word.startswith("--")}
    assert given <= set(_OPTION.findall(help_of_benchmark(*arguments)))


def test_every_option_that_is_named_exists():
    helps = [help_of(), *map(help_of, subcommands()), *(help_of_benchmark(*line) for line in benchmarks())]
    known = _FOREIGN.union(["--help"], *map(_OPTION.findall, helps))
    named = {(page, option) for page, span in spans() for option in _OPTION.findall(span)}
    assert not {(page, option) for page, option in named if option not in known}


def test_every_target_of_make_that_is_named_exists():
    targets = re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE)
    named = [span.split()[1] for _, span in spans() if re.match(r"make [a-z]", span)]
    named += [words(line)[1] for path in TEXTS for line in indented(text_of(path)) if line.startswith("make ")]
    assert named and set(named) <= set(targets)


# --- the library ---


@pytest.fixture
def walk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The files of the examples: walk.mp4, its keypoints as OpenPose writes them, and the truth."""
    moving = motion(4)
    truth = reference_of("walk", "made", shipped_body(), moving, frame_rate=25.0, in_camera=True)
    write_reference(tmp_path / "truth.npz", truth)
    filmed(tmp_path / "walk.mp4", clip_of(moving, noise=2.0).keypoints, monkeypatch)
    monkeypatch.chdir(tmp_path)


def filmed(path: Path, keypoints: Keypoints, monkeypatch: pytest.MonkeyPatch) -> None:
    """A black video, beside it its keypoints, and a detector that finds the same."""
    monkeypatch.setitem(DETECTORS, "mediapipe", known(FakeDetector(one_person(keypoints))))
    write_openpose(path.with_name("keypoints"), keypoints, name=path.stem)
    write_film(path, [np.zeros((*CAMERA.size[::-1], 3), np.uint8)] * len(keypoints))


def examples(path: Path) -> list[str]:
    """A page's blocks of Python."""
    return [block for language, block in _FENCED.findall(text_of(path)) if language == "python"]


def test_the_pages_with_examples_are_known():
    """Those of plugins.md are a package, which tests/tcfit_app/test_plugins.py installs."""
    assert {page.name for page in PAGES if examples(page)} == {
        "plugins.md",
        "events.md",
        "engineers.md",
        "library.md",
        "formats.md",
        "people.md",
    }


def test_the_page_for_engineers_runs(walk: None, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture):
    monkeypatch.setitem(PRESETS, "tcfit", QUICK)
    names: dict[str, Any] = {}
    for example in examples(DOCS / "engineers.md"):
        exec(example, names)
    Path("walk-fit").rename("result")
    (example,) = examples(DOCS / "formats.md")
    exec(example, names)
    assert names["fit"]["poses"].shape == (4, 165)
    said = capsys.readouterr().out
    assert "4 frames; the right wrist moves at up to" in said and "(4, 63) (10,)\n[0 1]" in said and "y up" in said


@pytest.mark.thorough
def test_a_program_that_starts_tcfit_hears_of_it(
    walk: None, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
):
    """With what the command takes beside, so that it is quick."""
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    (example,) = examples(DOCS / "events.md")
    quick = '"--no-overlay", "--set", "relay_rounds=0", "--set", "settings.iterations=2", "--json"]'
    run = example.replace('["tcfit", ', f'["{sys.executable}", "-m", "tcfit_app", ').replace('"--json"]', quick)
    assert run != example
    exec(run, {})
    said = capsys.readouterr().out
    assert "final fit: " in said and "failed" not in said and Path("walk-fit/fit.npz").is_file()


def test_the_examples_run(
    walk: None, off_screen_gl: None, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
):
    monkeypatch.setitem(PRESETS, "tcfit", QUICK)
    names: dict[str, Any] = {}
    for example in examples(DOCS / "library.md"):
        exec(example, names)
    said = capsys.readouterr().out
    assert all(text in said for text in ("torch.Size([4, 63])", "phase 3: ", "Re-run", "PA-MPJPE", "(4, 55, 3)"))
    assert all(Path(name).stat().st_size > 1000 for name in ("walk.glb", "walk.bvh", "walk.npz", "walk-fit/fit.npz"))


def test_the_page_of_several_people_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
):
    monkeypatch.setitem(PRESETS, "tcfit", QUICK)
    monkeypatch.chdir(tmp_path)
    filmed(tmp_path / "talk.mp4", clip_of(motion(8), noise=2.0).keypoints, monkeypatch)
    (example,) = examples(DOCS / "people.md")
    exec(example, {})
    assert "person 1 (0, 7) ()" in capsys.readouterr().out


def test_the_readme_and_the_package_have_the_example_that_runs():
    of_package = [block for _, block in _FENCED.findall(fitting_core.__doc__ or "")]
    assert examples(ROOT / "README.md") == examples(DOCS / "library.md")[:1] == of_package


def test_every_documented_name_of_the_library_exists():
    named = re.findall(r"^::: (\S+)$", text_of(DOCS / "library.md"), re.MULTILINE)
    assert named
    for name in named:
        module, _, attribute = name.rpartition(".")
        assert hasattr(importlib.import_module(module), attribute), name
