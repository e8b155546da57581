"""What is told of terms elsewhere is what their files declare."""

import dataclasses

from fitting_core.config.schema import PRESETS
from fitting_core.fit.terms.table import TERMS
from tests.drivers.written_terms import written


def test_the_docs_table_is_as_written_from_the_terms():
    for path, text in written().items():
        assert path.read_text(encoding="utf-8") == text, f"{path}: run python -m tests.drivers.written_terms"


def test_a_weight_belongs_to_one_term():
    names = [weight for entry in TERMS.values() for weight in entry.weights]
    assert sorted(names) == sorted(field.name for field in dataclasses.fields(PRESETS["paper"].weights))
