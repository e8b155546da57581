"""The directions in which modules may import each other, read from their source."""

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
MODULES = {
    ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path
    for package in ("fitting_core", "tcfit_app")
    for path in sorted((ROOT / package).rglob("*.py"))
}

LAYERS = [
    ["errors", "config", "config_file", "settings", "frame_names", "frame_rates", "io.atomic", "npz"],
    ["rotations"],
    ["camera", "keypoints", "body", "reliability"],
    ["clip"],
    ["priors", "state", "point_jacobian", "estimate", "joint_angles", "collision"],
    ["terms", "collision.term", "joint_limits"],
    ["objective", "term_table"],
    ["stages", "solvers", "temporal", "initialize"],
    ["phases"],
    ["result", "events", "fitting", "objective_values"],
]
"""A module imports from its own layer and from those above; packages stand for all their modules."""
DATA_TYPES = "errors npz rotations camera keypoints body clip config events result frame_names frame_rates".split()
OUTER = {
    # The summary of a fit tells figures: metrics and reliability are arithmetic on arrays and import nothing else.
    "io": ["io", "video", "config_file", "evaluation.metrics", "reliability", *DATA_TYPES],
    "evaluation": ["evaluation", "io", "encode", "video", *DATA_TYPES],
    # A format of points (io.coco_wholebody_layout), and files that appear whole (io.atomic).
    "detect": ["detect", "io", "video", *DATA_TYPES],
    "render": ["render", "off_screen", *DATA_TYPES],
    "overlay": ["overlay", "render", "off_screen", "encode", "video", *DATA_TYPES],
    "video": ["video", "video_file", *DATA_TYPES],
    "video_file": ["video_container", *DATA_TYPES],
    "video_container": [*DATA_TYPES],
    "encode": ["encode", "io.atomic", *DATA_TYPES],
    "priors.sheets": ["render", "io.atomic", *DATA_TYPES],
    "priors.train": ["priors", "io.atomic", "joint_angles", *DATA_TYPES],
}
"""What stands beside the fitter uses data types only; packages stand for all their modules but those in LAYERS."""
APP_LAYERS = {
    "plain values": "frame_words edit_windows notices changes byte_cache memory jpeg playback corrected edits edit_log",
    "what a project keeps": "storage project project_file bodies",
    "what is computed to be drawn": "background frame_by_frame meshes posed_fit body_regions curves findings suspicion "
    "run_metrics reference_metrics between_runs video_frames",
    "fitting beside the app": "jobs live outbox job_clock worker run_jobs running_job fits result_uploads "
    "importing uploads keypoint_jobs job_thread keypoint_source following session",
    "what all tabs draw from": "desk overlay_video export_source export_figures body_pictures worst_frames "
    "evaluated_fits evaluating export_report exports exporting",
    "scene, script and messages of viser's page": "view",
    "one tab": "view_state presses actions status picture strip correcting reviewing submitting panels key_list page",
    "all tabs": "app address gate gated_viser server",
    "commands": "ahead options detect_options import_options export_options evaluate_options reference_options "
    "evaluation_files suite_runs ablations suite_command evaluate_command "
    "progress clip_input probes doctor fit_command detect_command models_command reopening new_command review_command "
    "demo_command import_command export_command child_processes batch "
    "batch_options batch_command bench bench_options bench_command cli __main__",
}
"""Of the app: a module imports from its own layer and from those above."""
APP_BESIDE = {"view": ["view"], "server": ["server", "gate", "gated_viser", "address"], "panels.html": ["actions"]}
"""Of the app: what knows of nothing but these."""
NO_VISER = [name for layer in list(APP_LAYERS)[:5] for name in APP_LAYERS[layer].split()]
"""What works without a browser."""


def imported(tree: ast.AST) -> Iterator[str]:
    """Names of all modules that a file imports, wherever in it; `from a import b` counts as a and as a.b.

    What is imported for annotations alone (under TYPE_CHECKING) does not count: no such import ever runs.
    """
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING":
            continue
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0 and node.module, "imports are absolute"
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
        yield from imported(node)


def imports_of(module: str) -> set[str]:
    return set(imported(ast.parse(MODULES[module].read_text())))


def inside(name: str, packages: list[str]) -> bool:
    return any(name == p or name.startswith(f"{p}.") for p in packages)


def own_imports(module: str) -> set[str]:
    """Modules of fitting_core that it imports, without the package's name."""
    known = {name for name in imports_of(module) if name in MODULES and name.startswith("fitting_core.")}
    return {name.removeprefix("fitting_core.") for name in known}


def layer_of(name: str) -> int | None:
    """The layer of the longest entry that holds the module; None if none does, or if one of OUTER is longer."""
    best: tuple[int, int | None] | None = max(((len(e), None) for e in OUTER if inside(name, [e])), default=None)
    for level, entries in enumerate(LAYERS):
        for entry in entries:
            if inside(name, [entry]) and (best is None or len(entry) > best[0]):
                best = (len(entry), level)
    return None if best is None else best[1]


CORE = [m for m in MODULES if m.startswith("fitting_core")]


def test_the_reader_of_imports_finds_them():
    source = "import a.b\nif x:\n    from c import d\ndef f():\n    import e\nif TYPE_CHECKING:\n    import g\n"
    assert set(imported(ast.parse(source))) == {"a.b", "c", "c.d", "e"}
    assert {"rotations", "state", "fitting"} <= {m.removeprefix("fitting_core.") for m in CORE}
    assert "body.kinematics" in own_imports("fitting_core.body.mesh")


@pytest.mark.parametrize("module", CORE)
def test_the_core_knows_no_viewer_and_no_app(module: str):
    assert not {name for name in imports_of(module) if inside(name, ["viser", "tcfit_app", "tests"])}


@pytest.mark.parametrize("module", MODULES)
def test_pyrender_is_imported_in_one_place(module: str):
    allowed = ("fitting_core.render", "fitting_core.off_screen", "tcfit_app.probes")
    if module not in allowed:  # the probe asks whether it can be imported at all
        assert not {name for name in imports_of(module) if inside(name, ["pyrender", "OpenGL"])}


@pytest.mark.parametrize("module", [m for m in CORE if layer_of(m.removeprefix("fitting_core.")) is not None])
def test_layers_of_the_fitter(module: str):
    level = layer_of(module.removeprefix("fitting_core."))
    assert level is not None
    above = {name for name in own_imports(module) if (found := layer_of(name)) is None or found > level}
    assert not above, f"{module} must not import {sorted(above)}"


@pytest.mark.parametrize("package", OUTER)
def test_beside_the_fitter_only_data_types_are_used(package: str):
    members = [m for m in CORE if inside(m.removeprefix("fitting_core."), [package])]
    assert members
    for module in members:
        others = {name for name in own_imports(module) if not inside(name, OUTER[package])}
        assert not others, f"{module} must not import {sorted(others)}"


APP = [m.removeprefix("tcfit_app.") for m in MODULES if m.startswith("tcfit_app.")]


def app_imports(module: str) -> set[str]:
    """Modules of tcfit_app that one of them imports, without the package's name."""
    used = {name for name in imports_of(f"tcfit_app.{module}") if name in MODULES and name.startswith("tcfit_app.")}
    return {name.removeprefix("tcfit_app.") for name in used}


@pytest.mark.parametrize("layer", APP_LAYERS)
def test_layers_of_the_app(layer: str):
    place = list(APP_LAYERS).index(layer)
    allowed = [entry for entries in list(APP_LAYERS.values())[: place + 1] for entry in entries.split()]
    members = [m for m in APP if inside(m, APP_LAYERS[layer].split())]
    assert members
    for module in members:
        others = {name for name in app_imports(module) if not inside(name, allowed)}
        assert not others, f"{module} must not import {sorted(others)}"


@pytest.mark.parametrize("package", APP_BESIDE)
def test_parts_of_the_app_that_stand_alone(package: str):
    for module in (m for m in APP if inside(m, [package])):
        assert all(inside(name, APP_BESIDE[package]) for name in app_imports(module)), module


def test_only_what_a_browser_shows_knows_viser():
    assert not [
        m for m in APP if inside(m, NO_VISER) and any(inside(n, ["viser"]) for n in imports_of(f"tcfit_app.{m}"))
    ]


def test_every_module_of_the_app_has_its_layer():
    entries = [entry for layer in APP_LAYERS.values() for entry in layer.split()]
    assert [m for m in APP if not inside(m, entries)] == []
    assert [entry for entry in entries if not any(inside(m, [entry]) for m in APP)] == []


def test_no_module_imports_itself_in_a_circle():
    graph = {m: {n for n in imports_of(m) if n in MODULES and n != m} for m in MODULES}
    reached: dict[str, set[str]] = {}
    for module in graph:
        open_modules, seen = [module], set()
        while open_modules:
            for name in graph[open_modules.pop()] - seen:
                seen.add(name)
                open_modules.append(name)
        reached[module] = seen
    assert not sorted(m for m, seen in reached.items() if m in seen)


@pytest.mark.parametrize("module", ["tcfit_app.cli", "fitting_core.config", "fitting_core.camera", "fitting_core.clip"])
def test_light_modules_load_no_torch(module: str):
    code = f"import sys, {module}; print(sorted({{'torch', 'viser', 'pyrender'}} & set(sys.modules)))"
    out = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "[]"


def test_every_module_of_the_core_has_its_place():
    """A new module belongs into LAYERS or OUTER, so that its direction is held."""
    names = [m.removeprefix("fitting_core.") for m in CORE if m != "fitting_core"]
    homeless = [n for n in names if layer_of(n) is None and not inside(n, list(OUTER))]
    assert set(homeless) <= {"off_screen"}
