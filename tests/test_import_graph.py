"""The directions in which modules may import each other, read from their source and from the folders they lie in."""

import ast
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
MODULES = {
    ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path
    for package in ("fitting_core", "tcfit_app", "build_assets", "evaluation")
    for path in sorted((ROOT / package).rglob("*.py"))
}
FLOORS = {
    "fitting_core": """
        errors frame_runs lazy_names memory keypoint_noise keypoints least_squares plugins shipped silhouettes
        camera lens wholebody config files body
        clip detections image_border metrics priors video lifting ground world_camera
        frame_alignment results people
        motion
        animation
        io
        fit detect
        starts clips
        render
        measure
    """,
    "tcfit_app": """
        options
        project
        fitting
        analysis imports
        evaluation server
        exports
        review batch plugin_api
        home
        cli
        __main__
    """,
}
"""The rooms of each package, a line for each floor: a room imports only from floors before its own.

Rooms of one floor are listed together because they may import each other in one direction; a circle is refused
everywhere, in every folder at every depth."""


def imported(tree: ast.AST) -> Iterator[str]:
    """Names of all modules that a file imports, wherever in it and for whatever reason, annotations included;
    `from a import b` counts as a.b, which may be a module, and as a."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0 and node.module, "imports are absolute"
            for alias in node.names:
                name = f"{node.module}.{alias.name}"
                yield name if name in MODULES else node.module


@cache
def imports_of(module: str) -> set[str]:
    return names_in(MODULES[module])


def names_in(path: Path) -> set[str]:
    """Modules that any file imports."""
    return set(imported(ast.parse(path.read_text())))


@cache
def graph() -> dict[str, set[str]]:
    """By module, which others of the packages it imports."""
    return {module: {name for name in imports_of(module) if name in MODULES and name != module} for module in MODULES}


def inside(name: str, package: str) -> bool:
    return name == package or name.startswith(f"{package}.")


def entries(module: str) -> tuple[str, ...]:
    """Its way down the folders; a package's own file is an entry of the package."""
    own = ("__init__",) if MODULES[module].name == "__init__.py" else ()
    return (*module.split("."), *own)


@cache
def arrows() -> dict[str, dict[str, set[str]]]:
    """By folder, which of its entries (files and folders) imports which others."""
    found: dict[str, dict[str, set[str]]] = {}
    for module, others in graph().items():
        for other in others:
            one, two = entries(module), entries(other)
            depth = next(i for i, pair in enumerate(zip(one, two, strict=False)) if pair[0] != pair[1])
            if depth:
                found.setdefault(".".join(one[:depth]), {}).setdefault(one[depth], set()).add(two[depth])
    return found


def reached(graph: dict[str, set[str]], start: str) -> set[str]:
    """Everything that can be got to from an entry in one step or more."""
    found, waiting = set(), [start]
    while waiting:
        for name in graph.get(waiting.pop(), set()) - found:
            found.add(name)
            waiting.append(name)
    return found


def test_the_reader_of_imports_finds_them():
    source = "import a.b\nif x:\n    from c import d\ndef f():\n    import e\nif TYPE_CHECKING:\n    import g\n"
    assert set(imported(ast.parse(source))) == {"a.b", "c", "e", "g"}
    assert "fitting_core.fit.fitting" in MODULES
    assert "fitting_core.body.kinematics" in graph()["fitting_core.body.mesh"]
    assert "b" in reached({"a": {"c"}, "c": {"b"}}, "a") and "a" not in reached({"a": {"c"}}, "a")


def test_no_module_imports_itself_in_a_circle():
    assert not sorted(module for module in graph() if module in reached(graph(), module))


def test_no_circle_among_the_entries_of_any_folder():
    circles = {(folder, entry) for folder, by in arrows().items() for entry in by if entry in reached(by, entry)}
    assert not sorted(circles)


@pytest.mark.parametrize("package", FLOORS)
def test_rooms_import_from_the_floors_below(package: str):
    floors = [line.split() for line in FLOORS[package].strip().splitlines()]
    level = {room: number for number, floor in enumerate(floors) for room in floor}
    assert set(level) == {entries(module)[1] for module in MODULES if inside(module, package)} - {"__init__"}
    for room, others in arrows()[package].items():
        upwards = {other for other in others if level[other] > level[room]} if room != "__init__" else set()
        assert not upwards, f"{package}/{room} must not import {sorted(upwards)}"


def test_the_core_knows_no_viewer_and_no_app():
    used = {(m, name) for m in MODULES if inside(m, "fitting_core") for name in imports_of(m)}
    assert not [pair for pair in used if pair[1].split(".")[0] in ("viser", "tcfit_app")]


def test_what_is_installed_uses_nothing_that_is_not():
    beside = {path.name for path in ROOT.iterdir() if any(path.glob("*.py"))} - FLOORS.keys()
    assert {"assets", "benchmarks", "build_assets", "evaluation", "tests"} <= beside
    installed = [module for module in MODULES if module.split(".")[0] in FLOORS]
    assert not [(m, name) for m in installed for name in imports_of(m) if name.split(".")[0] in beside]


def test_benchmarks_use_what_tests_share_and_not_the_other_way():
    files = [path for path in (ROOT / "tests").rglob("*.py") if path != Path(__file__).resolve()]
    assert files and not [path for path in files if "benchmarks" in {n.split(".")[0] for n in names_in(path)}]
    shared = {n for path in (ROOT / "benchmarks").rglob("*.py") for n in names_in(path) if inside(n, "tests")}
    assert {name.split(".")[1] for name in shared} <= {"samples", "drivers"}


def test_only_the_reviews_and_their_server_know_viser():
    users = {m for m in MODULES if any(inside(name, "viser") for name in imports_of(m))}
    assert {tuple(m.split(".")[:2]) for m in users} == {("tcfit_app", room) for room in ("review", "home", "server")}


def test_pyrender_is_imported_in_one_place():
    users = {m for m in MODULES if any(inside(n, "pyrender") or inside(n, "OpenGL") for n in imports_of(m))}
    assert users == {"fitting_core.render.renderer", "fitting_core.render.off_screen"}


def test_a_fit_loads_only_what_it_needs():
    used = {module.split(".")[1] for module in reached(graph(), "fitting_core.fit.fitting")}
    assert not used & {"io", "people", "animation", "detect", "clips", "starts", "render", "measure"}


def test_reading_and_writing_estimates_nothing():
    """Whoever reads a file waits for no network and no solver: what is made of it is a step of its caller."""
    used = {
        name.split(".")[1]
        for module, others in graph().items()
        if inside(module, "fitting_core.io")
        for name in others
        if inside(name, "fitting_core")
    }
    assert not used & {"fit", "detect", "priors", "lifting", "starts", "clips"}


def loaded_by(module: str) -> set[str]:
    """Which of the packages that take long a module loads, in a new process."""
    slow = {"numpy", "torch", "viser", "pyrender", "scipy", "scipy.stats"}
    code = f"import sys, {module}; print(*{slow} & set(sys.modules))"
    out = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    return set(out.stdout.split())


@pytest.mark.parametrize("module", ["tcfit_app.cli.main", "fitting_core.config.schema"])
def test_the_command_line_is_read_without_numpy(module: str):
    assert not loaded_by(module)


@pytest.mark.parametrize("module", ["fitting_core.camera", "fitting_core.clip"])
def test_light_modules_load_no_torch(module: str):
    assert loaded_by(module) == {"numpy"}


def test_a_review_serves_its_page_before_torch_is_loaded():
    assert loaded_by("tcfit_app.cli.review_command") == {"numpy", "viser"}


def test_the_first_picture_is_drawn_before_torch_is_loaded():
    assert loaded_by("tcfit_app.review.early_tabs") == {"numpy", "viser"}


def test_an_app_that_draws_has_not_loaded_what_only_some_fits_need():
    assert loaded_by("tcfit_app.review.app") == {"numpy", "torch", "viser", "scipy"}
