"""The notebooks of docs/ run from their first cell to their last, and are kept without what they print."""

from pathlib import Path

import pytest

pytestmark = pytest.mark.thorough

ROOT = Path(__file__).parents[1]
NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))

nbformat = pytest.importorskip("nbformat", reason="nbformat is not installed, which reads notebooks")
nbclient = pytest.importorskip("nbclient", reason="nbclient is not installed, which runs notebooks")


def read(path: Path):
    return nbformat.read(path, as_version=4)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_is_kept_without_outputs(path: Path):
    cells = [cell for cell in read(path).cells if cell.cell_type == "code"]
    assert cells and not any(cell.outputs or cell.execution_count for cell in cells)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs(path: Path, tmp_path: Path, off_screen_gl: None, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    monkeypatch.setenv("JUPYTER_PLATFORM_DIRS", "1")
    notebook = read(path)
    nbclient.NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(tmp_path)}}).execute()
    printed = "".join(output.get("text", "") for cell in notebook.cells for output in cell.get("outputs", ()) if output)
    expected = {"1-fit-and-look": ("8 frames", "demo.glb"), "2-compare-and-evaluate": ("PA-MPJPE", "demo-fit done")}
    assert all(text in printed for text in expected[path.stem])
    pictures = [o for cell in notebook.cells for o in cell.get("outputs", ()) if "image/jpeg" in o.get("data", {})]
    assert len(pictures) == (2 if path.stem.startswith("1") else 0)
