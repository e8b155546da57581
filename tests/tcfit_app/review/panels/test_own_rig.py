"""The user's own rig in the panel Export: uploaded, its joints picked by names, kept in the project, exported."""

import json
import threading
import tomllib
from collections.abc import Iterator
from pathlib import Path
from unittest.mock import MagicMock

import pytest
import viser

from fitting_core.body.model import BodyModel
from fitting_core.io.motion.rigs.mapping_file import read_mapping
from tcfit_app.project.storage.rig import keep_rig, kept_rig
from tcfit_app.review.page import Page
from tcfit_app.review.panels.export_panel import ExportPanel
from tcfit_app.review.session import own_rig
from tcfit_app.review.session.own_rig import OwnRig
from tcfit_app.review.tab.browser_tab import BrowserTab
from tcfit_app.server.page_files import PageFiles
from tests.drivers.lone_page import LonePage, tiny_page
from tests.fitting_core.io.motion.rigs.rig_files import PERSON, bvh_text, glb_bytes, gltf_document

ODD = tuple((*(name.replace("LeftForeArm", "Bone_7") for name in bone[:2]), bone[2]) for bone in PERSON)
"""With a forearm that no name tells."""


@pytest.fixture
def tested(panel_server: viser.ViserServer, tmp_path: Path, tiny_body: BodyModel) -> Iterator[LonePage]:
    with tiny_page(panel_server, tmp_path / "p", tiny_body, ExportPanel) as page:
        yield page


def upload(tested: LonePage, name: str, content: bytes) -> None:
    button = tested.field("Upload a rig")
    button._impl.value = viser.UploadedFile(name=name, content=content)
    tested.call_back(button, MagicMock())
    tested.settle()
    tested.draw()


def downloaded(tested: LonePage, name: str) -> bytes:
    tested.press("export.begin", name)
    running = tested.panels[0].running
    tested.settle()
    assert running.state == "finished", running.reason
    return tested.downloads[running.title]


def test_a_rig_is_uploaded_completed_kept_and_exported(tested: LonePage):
    tested.fit()
    upload(tested, "hero.glb", glb_bytes(gltf_document(ODD)))
    folder = tested.page.tab.session.project.folder / "rig"
    assert sorted(path.name for path in folder.iterdir()) == ["hero.glb", "mapping.toml"]
    assert "no joint stands for left_elbow (left forearm)" in tested.html() and tested.button("Own rig (GLB)").disabled
    assert tested.field("right forearm").value == "RightForeArm" and tested.field("spine").value == "Spine, Spine1"
    forearm = tested.field("left forearm – missing")
    assert forearm.value == "none" and {"none", "Bone_7", "Hips"} < set(forearm.options)
    tested.enter("left forearm – missing", "Bone_7")
    assert not tested.button("Own rig (GLB)").disabled and tested.field("left forearm").value == "Bone_7"
    assert read_mapping(folder / "mapping.toml").joints["left_elbow"] == ("Bone_7",)
    assert downloaded(tested, "rig-glb").startswith(b"glTF") and b"ROOT Hips" in downloaded(tested, "rig-bvh")
    tested.press("rig.download")
    assert tomllib.loads(tested.downloads["hero.toml"].decode())["joints"]["left_elbow"] == "Bone_7"
    found = kept_rig(tested.page.tab.session.project.folder)
    assert found is not None and found.joints["left_elbow"] == ("Bone_7",), "it is there tomorrow"


def test_a_joint_stands_for_one_part(tested: LonePage):
    upload(tested, "hero.bvh", bvh_text().encode())
    tested.enter("left thigh", "RightUpLeg")
    tested.draw()
    assert tested.field("right thigh – missing").value == "none"
    tested.enter("spine", " Spine1 ")
    tested.draw()
    kept = kept_rig(tested.page.tab.session.project.folder)
    assert kept is not None and kept.joints["left_hip"] == ("RightUpLeg",) and kept.joints["spine"] == ("Spine1",)
    tested.fit()
    tested.draw()
    assert tested.button("Own rig (GLB)").disabled, "a BVH has no surface"


def test_another_rig_takes_the_place_of_the_first(tested: LonePage):
    upload(tested, "hero.glb", glb_bytes(gltf_document()))
    upload(tested, "villain.bvh", bvh_text(ODD).encode())
    folder = tested.page.tab.session.project.folder / "rig"
    assert sorted(path.name for path in folder.iterdir()) == ["mapping.toml", "villain.bvh"]
    assert "Bone_7" in tested.field("left forearm – missing").options


def test_a_rig_that_another_tab_has_uploaded_is_the_one_that_is_mapped(tested: LonePage):
    upload(tested, "hero.glb", glb_bytes(gltf_document()))
    tab = tested.page.tab
    other = Page(BrowserTab(tab.client, lambda command: command(), PageFiles(here=True)), tab.someone)
    (panel,) = (panel for panel in other.panels if isinstance(panel, ExportPanel))
    panel._own_rig._begin(viser.UploadedFile(name="villain.bvh", content=bvh_text(ODD).encode()))
    other.close()
    tested.settle()
    assert "villain.bvh" in tested.html()
    tested.enter("left forearm – missing", "Bone_7")
    kept = kept_rig(tab.session.project.folder)
    assert kept is not None and kept.rig.name == "villain.bvh" and kept.joints["left_elbow"] == ("Bone_7",)


def test_while_a_rig_is_read_the_one_before_is_not_mapped(tested: LonePage, monkeypatch: pytest.MonkeyPatch):
    upload(tested, "hero.glb", glb_bytes(gltf_document()))
    goes_on = threading.Event()
    monkeypatch.setattr(own_rig, "keep_rig", lambda *given: (goes_on.wait(20), keep_rig(*given))[1])
    button = tested.field("Upload a rig")
    button._impl.value = viser.UploadedFile(name="villain.bvh", content=bvh_text(ODD).encode())
    tested.call_back(button, MagicMock())
    tested.enter("left thigh", "RightUpLeg")
    assert "still being read" in tested.notices[-1].text
    goes_on.set()
    tested.settle()
    kept = kept_rig(tested.page.tab.session.project.folder)
    assert kept is not None and kept.rig.name == "villain.bvh" and kept.joints["left_hip"] == ("LeftUpLeg",)


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("hero.fbx", b"Kaydara", "Convert it to GLB"),
        ("hero.glb", b"glTF and no more", "hero.glb"),
        ("hero.bvh", b"\xff\xfe nothing", "hero.bvh"),
        ("hero.gltf", json.dumps(gltf_document() | {"buffers": [{"uri": "a.bin", "byteLength": 4}]}).encode(), "a.bin"),
        ("../mapping.toml", b"[joints]", "is not read as a rig"),
    ],
)
def test_what_is_no_rig_is_told_and_changes_nothing(tested: LonePage, name: str, content: bytes, said: str):
    upload(tested, "good.glb", glb_bytes(gltf_document()))
    folder = tested.page.tab.session.project.folder / "rig"
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    upload(tested, name, content)
    assert any(said in notice.text for notice in tested.notices)
    assert not any("tcfit-scratch" in notice.text for notice in tested.notices)
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before
    assert tested.field("right forearm").value == "RightForeArm"


def test_a_rig_that_was_damaged_is_told(tested: LonePage):
    upload(tested, "hero.glb", glb_bytes(gltf_document()))
    session = tested.page.tab.session
    (session.project.folder / "rig" / "mapping.toml").write_text("skeleton = 3")
    session.rig = OwnRig(session.project.folder)
    assert "cannot be read" in tested.html() and "Upload it again" in tested.html()


def test_a_name_in_the_mapping_that_the_rig_does_not_have_is_told(tested: LonePage):
    upload(tested, "hero.glb", glb_bytes(gltf_document()))
    session = tested.page.tab.session
    mapping = session.project.folder / "rig" / "mapping.toml"
    mapping.write_text(mapping.read_text().replace('"LeftUpLeg"', '"Leg of the left"'))
    session.rig = OwnRig(session.project.folder)
    assert "has no joint &#x27;Leg of the left&#x27; for left_hip" in tested.html()
    assert tested.field("left thigh").value in tested.field("left thigh").options
