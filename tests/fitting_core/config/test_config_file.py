"""Configurations: files, single settings, what is refused and with which words."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from fitting_core.config.schema import PRESETS, fits_as_smplifyx, without_collisions
from fitting_core.config.settings import changed, check, settings, value_of
from fitting_core.config.toml import as_toml, read_config
from fitting_core.errors import InputError


@pytest.fixture
def write(tmp_path: Path):
    """write(text): a TOML file with it."""

    def write(text: str) -> Path:
        path = tmp_path / "mine.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return write


def test_file_changes_the_preset_that_it_names(write):
    config = read_config(write('preset = "paper"\nsolver = "lbfgs"\n[temporal]\nwindow_size = 9\nstages = [4, 5]'))
    paper = PRESETS["paper"]
    temporal = replace(paper.temporal, window_size=9, stages=(4, 5))
    assert config == replace(paper, solver="lbfgs", temporal=temporal)


def test_default_preset_and_preset_from_outside(write):
    assert read_config(write("")) == PRESETS["tcfit"]
    named = write('preset = "paper"\nhip_weight = 0.5')
    assert read_config(named, preset_name="smplifyx") == replace(PRESETS["smplifyx"], hip_weight=0.5)


@pytest.mark.parametrize("name", PRESETS)
def test_written_file_reads_as_the_same_configuration(write, name: str):
    other = next(n for n in PRESETS if n != name)
    assert read_config(write(as_toml(PRESETS[name], preset_name=other))) == PRESETS[name]


def test_written_file_says_what_every_setting_means(write):
    lines = as_toml(PRESETS["tcfit"], preset_name="tcfit").splitlines()
    for name in settings():
        leaf = name.rpartition(".")[2]
        places = [i for i, line in enumerate(lines) if line.startswith(f"{leaf} = ")]
        assert places and all(lines[i - 1].startswith("# ") and len(lines[i - 1]) > 5 for i in places)


BAD_FILES = {
    "no TOML": ("solver = ", "is not TOML"),
    "unknown": ("sovler = 'lm'", "no setting 'sovler'; did you mean solver?"),
    "unknown in a table": ("[temporal]\nwieght = 3", "no setting 'temporal.wieght'; did you mean temporal.weight"),
    "in the wrong place": ("window_size = 5", "did you mean temporal.window_size?"),
    "unknown table": ("[wieghts]\nshape = [1, 2, 3, 4, 5]", "no setting 'wieghts'; did you mean weights"),
    "unknown below a setting": ("[solver]\nkind = 'lm'", 'solver is {"kind":"lm"}; expected one of lm, lbfgs'),
    "value for a table": ("weights = 3", "weights is a group of settings; expected a table [weights]"),
    "preset": ("preset = 'papr'", "no preset 'papr'; expected one of smplifyx, paper, tcfit. Did you mean paper?"),
    "choice": ("solver = 'adam'", 'solver is "adam"; expected one of lm, lbfgs'),
    "text for a number": ("hip_weight = '1'", 'hip_weight is "1"; expected a number'),
    "truth for a number": ("hip_weight = true", "hip_weight is true; expected a number"),
    "number for truth": ("camera_frozen = 1", "camera_frozen is 1; expected true or false"),
    "fraction": ("relay_rounds = 1.5", "relay_rounds is 1.5; expected a whole number"),
    "too few": ("[weights]\nshape = [1, 2, 3]", "weights.shape is [1,2,3]; expected 5 numbers, one for each stage"),
    "negative weight": ("[weights]\nshape = [1, 2, 3, 4, -5]", "weights.shape is -5; expected 0 or more"),
    "not finite": ("[temporal]\nweight = nan", "temporal.weight is nan; expected 0 or more"),
    "no stage": ("[temporal]\nstages = []", "temporal.stages is empty; expected at least one number, 1 to 5"),
    "stage": ("[shape_sample]\nstages = [5, 6]", "shape_sample.stages is 6; expected 1 to 5"),
    "tolerance": ("[settings]\nsequence_tolerance = 5", "sequence_tolerance is 5; expected above 0 and below 1"),
    "device": ("device = 'gpu'", "device is 'gpu'; expected cpu, cuda"),
    "pose prior": (
        "pose_prior = 'vpsoer'",
        "pose_prior is 'vpsoer', neither a name nor an existing file; expected one of",
    ),
}


@pytest.mark.parametrize("case", BAD_FILES)
def test_bad_file_is_refused(write, case: str):
    text, message = BAD_FILES[case]
    with pytest.raises(InputError) as caught:
        read_config(write(text))
    assert str(caught.value).startswith(("mine.toml: ", str(write(text)))) and message in str(caught.value)


def test_files_that_are_no_text(tmp_path: Path):
    with pytest.raises(InputError, match="cannot be read"):
        read_config(tmp_path / "missing.toml")
    with pytest.raises(InputError, match="is a folder, expected a file"):
        read_config(tmp_path)
    (tmp_path / "bytes.toml").write_bytes(b"\xff\xfe")
    with pytest.raises(InputError, match="UTF-8"):
        read_config(tmp_path / "bytes.toml")


@pytest.mark.parametrize(
    ("name", "text", "value"),
    [
        ("weights.body_pose", "404,404, 57.4,4.78,4.78", (404.0, 404.0, 57.4, 4.78, 4.78)),
        ("temporal.stages", "[4, 5]", (4, 5)),
        ("temporal.stages", "5", (5,)),
        ("last_phase", "2", 2),
        ("camera_frozen", "true", True),
        ("robust_at_height", "none", None),
        ("robust_at_height", "720", 720.0),
        ("settings.final_tolerance", "1e-8", 1e-8),
        ("device", "cuda:1", "cuda:1"),
    ],
)
def test_texts_become_values(name: str, text: str, value: Any):
    found = value_of(changed(PRESETS["tcfit"], {name: text}, origin="--set", texts=True), name)
    assert found == value and type(found) is type(value)


@pytest.mark.parametrize("name", PRESETS)
def test_presets_lie_within_the_ranges(name: str):
    check(PRESETS[name])


def test_a_device_that_lacks_the_precision_is_refused():
    on_mps = {"device": "mps"}
    refused = changed(PRESETS["tcfit"], on_mps, origin="mine.toml")
    with pytest.raises(InputError, match=r"device mps cannot compute in float64.*Set precision to float32"):
        check(refused)
    check(changed(PRESETS["tcfit"], on_mps | {"precision": "float32"}, origin="mine.toml"))


def test_phase_1_is_smplify_x_with_its_own_preset_alone():
    known = PRESETS["smplifyx"]
    assert [name for name, config in PRESETS.items() if fits_as_smplifyx(config)] == ["smplifyx"]
    beside = replace(known, last_phase=1, temporal=replace(known.temporal, weight=3.0))
    assert fits_as_smplifyx(without_collisions(beside))
    assert not fits_as_smplifyx(replace(known, relay_rounds=3))
