"""The user's own rig in Chromium: uploaded, completed by a name of the list, exported."""

from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from fitting_core.body.model import BodyModel
from tests.drivers.review_page import reviewing
from tests.fitting_core.io.motion.rigs.rig_files import glb_bytes, gltf_document
from tests.samples.waving import waving_project
from tests.tcfit_app.review.panels.test_own_rig import ODD

if TYPE_CHECKING:
    from playwright.sync_api import Browser

pytestmark = pytest.mark.thorough

_OPENED = """(input) => {
  for (let box = input; box; box = box.parentElement)
    if (getComputedStyle(box).overflowY === "hidden" && box.clientHeight < box.scrollHeight) return false;
  return input.clientHeight > 0;
}"""
"""Whether nothing that grows clips an input any more."""
_CUT = "(spans) => spans.filter((span) => span.scrollWidth > span.clientWidth).map((span) => span.textContent)"
"""Texts of buttons that are not shown in full."""


def test_a_rig_is_uploaded_completed_and_exported(browser: "Browser", free_body: BodyModel, tmp_path: Path):
    folder = waving_project(tmp_path / "walk.tcfit", free_body)
    (tmp_path / "hero.glb").write_bytes(glb_bytes(gltf_document(ODD)))
    with reviewing(folder, browser) as review:
        tab = review.tab
        tab.get_by_role("tab", name="Export", exact=True).click()
        tab.get_by_role("button", name="Character (FBX)").wait_for()
        assert tab.locator(".tcfit-cells button > span").evaluate_all(_CUT) == []
        tab.get_by_text("Own rig", exact=True).click()
        with tab.expect_file_chooser() as chooser:
            tab.get_by_role("button", name="Upload a rig").click()
        chooser.value.set_files(tmp_path / "hero.glb")
        tab.get_by_text("no joint stands for").wait_for()
        export = tab.get_by_role("button", name="Own rig (GLB)")
        assert export.is_disabled()
        tab.get_by_text("Its body").click()
        missing = "left forearm – missing"
        forearm = tab.locator(f"xpath=//*[normalize-space(text())='{missing}']/following::input[1]")
        # While the folder opens, a click finds the input by scrolling inside of it, and the list is hidden as soon as
        # the folder has grown and its input is out of sight.
        tab.wait_for_function(_OPENED, arg=forearm.element_handle())
        forearm.click()
        tab.get_by_role("option", name="Bone_7").click()
        tab.get_by_text("28 of 53 parts").wait_for()
        with tab.expect_download(timeout=60_000) as download:
            export.click()
        assert download.value.suggested_filename == "walk.rig.glb"
        assert not review.complaints
