"""Very many clips: what most of them have in common is looked at once."""

from collections import Counter
from pathlib import Path
from typing import Any

import pytest

from tcfit_app.batch import inputs, manifest
from tcfit_app.batch.inputs import settings_of
from tests.tcfit_app.batch.test_batch_manifest import tasks_of


def counting(monkeypatch: pytest.MonkeyPatch, calls: Counter[str], module: Any, name: str) -> None:
    whole = getattr(module, name)

    def counted(*arguments: Any, **options: Any) -> Any:
        calls[name] += 1
        return whole(*arguments, **options)

    monkeypatch.setattr(module, name, counted)


def test_what_clips_have_in_common_is_made_and_written_down_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    calls: Counter[str] = Counter()
    for module, name in ((manifest, "fit_config"), (manifest, "changed"), (inputs, "as_plain")):
        counting(monkeypatch, calls, module, name)
    rows = "".join(f"k{i},o{i},{50 + i % 2},{'paper' if i % 3 else ''}\n" for i in range(3000))
    tasks = tasks_of(tmp_path, "keypoints,out,temporal_weight,preset\n" + rows)
    assert len({settings_of(task) for task in tasks}) == 4
    # By preset; by preset and weight; and so for what a fingerprint is made of. Milliseconds each, and not 3000 times.
    assert calls == {"fit_config": 2, "changed": 4, "as_plain": 4}
