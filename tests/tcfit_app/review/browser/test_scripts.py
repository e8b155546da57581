"""The page's pure scripts, in Node: what they work out, without a browser and without viser."""

import shutil
import subprocess
from pathlib import Path

import pytest

from tcfit_app.review.browser.channel import web_files

TESTS = Path(__file__).with_name("scripts")
NODE = shutil.which("node")


@pytest.mark.skipif(NODE is None, reason="Node is not installed: the page's scripts are tested in browsers only")
@pytest.mark.parametrize("tested", sorted(TESTS.glob("*.test.js")), ids=lambda path: path.name)
def test_scripts(tested: Path, tmp_path: Path) -> None:
    for path, content in web_files().items():
        file = tmp_path / path.removeprefix("/tcfit/")
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(content)
    shutil.copytree(TESTS / "stubs", tmp_path, dirs_exist_ok=True)
    shutil.copy(tested, tmp_path)
    (tmp_path / "package.json").write_text('{"type": "module"}')
    assert NODE is not None
    done = subprocess.run([NODE, "--test", tested.name], cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "# fail 0" in done.stdout and "# pass 0" not in done.stdout
