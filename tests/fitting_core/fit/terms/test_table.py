"""What is told of terms elsewhere is what their files declare."""

import dataclasses

from fitting_core.config.schema import PRESETS
from fitting_core.config.settings import settings
from fitting_core.fit.fused.constants import KERNELS
from fitting_core.fit.terms.table import TERMS
from tests.drivers.written_terms import written


def test_settings_and_docs_are_as_written_from_the_terms():
    for path, text in written().items():
        assert path.read_text(encoding="utf-8") == text, f"{path}: run python -m tests.drivers.written_terms"


def test_weights_of_the_presets_are_those_that_terms_declare():
    for entry in TERMS.values():
        for weight in entry.weights:
            for name, values in (("paper", weight.paper), ("smplifyx", weight.smplifyx), ("tcfit", weight.tcfit)):
                assert getattr(PRESETS[name].weights, weight.name) == (values or weight.paper), f"{name}: {weight.name}"
            assert settings()[f"weights.{weight.name}"].doc == weight.about


def test_a_weight_belongs_to_one_term():
    names = [weight.name for entry in TERMS.values() for weight in entry.weights]
    assert sorted(names) == sorted(field.name for field in dataclasses.fields(PRESETS["paper"].weights))


def test_no_two_kernels_have_a_field_of_the_same_name():
    names = [field[0] for k in KERNELS.values() for field in (*k.clip, *k.frame, *k.point, *k.keypoint)]
    assert len(names) == len(set(names)) > 20
