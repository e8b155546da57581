"""The list in a browser: shown, filtered, opened, gone through, approved; and what axe-core says of it."""

import re
from collections.abc import Iterator
from typing import TYPE_CHECKING

import pytest

from fitting_core.body.model import BodyModel
from tcfit_app.project.glance import glance
from tcfit_app.project.project import Project
from tests.drivers.waiting import until
from tests.tcfit_app.home.lists import folder_of_clips
from tests.tcfit_app.home.test_home import Served, served

if TYPE_CHECKING:
    from playwright.sync_api import Browser
    from playwright.sync_api import Page as Tab


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory, free_body: BodyModel) -> Iterator[Served]:
    with served(folder_of_clips(tmp_path_factory.mktemp("lab") / "corpus", free_body)) as running:
        yield running


@pytest.fixture
def tab(lab: Served, browser: "Browser") -> Iterator["Tab"]:
    context = browser.new_context(viewport={"width": 1280, "height": 720})
    context.add_cookies([{"name": "tcfit-hints", "value": "read", "url": lab.server.address.url}])
    tab = context.new_page()
    faults: list[str] = []
    tab.on("pageerror", lambda error: faults.append(str(error)))
    tab.goto(lab.server.gate.link)
    tab.wait_for_selector("tr.clip")
    yield tab
    context.close()
    assert faults == []


def names(tab: "Tab") -> list[str]:
    return tab.locator("tr.clip").evaluate_all("lines => lines.map((line) => line.querySelector('a').textContent)")


def test_filtered_searched_and_sorted(tab: "Tab"):
    assert names(tab) == ["a new", "walk", "walk", "walk"]
    tab.get_by_role("button", name="Approved").click()
    until(lambda: len(names(tab)) == 1)
    assert "good hands" in tab.locator("tr.clip").inner_text()
    tab.get_by_role("button", name=re.compile(r"^All \d")).click()
    tab.keyboard.press("/")
    tab.keyboard.type("bert")
    until(lambda: len(names(tab)) == 1)
    for finding, told in (("nothing suspicious", "good hands"), ("42 px", "Frame 10: left wrist")):
        tab.get_by_placeholder("Search").fill(finding)
        until(lambda told=told: len(names(tab)) == 1 and told in tab.locator("tr.clip").first.inner_text())
    tab.keyboard.press("Escape")
    until(lambda: len(names(tab)) == 4)
    tab.get_by_role("button", name="Worst place").click()
    until(lambda: "3.5" in tab.locator("tr.clip").first.inner_text())
    assert tab.locator("th[aria-sort=descending]").inner_text().startswith("Worst place")


def test_by_keys_alone(tab: "Tab", lab: Served):
    folder = lab.home.catalogue.root / "set" / "b fitted.tcfit"
    tab.keyboard.press("ArrowDown")
    until(lambda: tab.locator(":focus").get_attribute("data-key") == lab.key("set/b fitted.tcfit"))
    tab.keyboard.press("a")
    until(lambda: glance(folder).state == "approved")
    tab.keyboard.press("n")
    tab.get_by_label("Note on walk").last.fill("<b>thumb</b>")
    tab.keyboard.press("Enter")
    until(lambda: glance(folder).review.note == "<b>thumb</b>")
    until(lambda: "<b>thumb</b>" in tab.locator("tr.clip").nth(1).inner_text())
    tab.keyboard.press("a")
    until(lambda: glance(folder).state == "fitted")


def test_no_action_hits_a_clip_that_is_not_selected(tab: "Tab", lab: Served):
    """Two are selected, and a filter hides them."""
    third = lab.home.catalogue.root / "set" / "d approved.tcfit"
    rows = {place: tab.locator(f"tr[data-key='{lab.key(place)}']") for place in ("a new.tcfit", "set/b fitted.tcfit")}
    for row in rows.values():
        row.get_by_role("checkbox").click()
    tab.get_by_role("button", name="Approved").click()
    until(lambda: len(names(tab)) == 1)
    assert "2 selected, 2 of them hidden" in tab.locator("footer").inner_text()
    tab.locator("tr.clip").focus()
    for key in "afec":
        tab.keyboard.press(key)
        tab.get_by_text("hidden by the filter").wait_for()
        tab.get_by_role("button", name="Close").click()
    for name in ("Fit", "Export", "Open"):
        assert tab.get_by_role("button", name=re.compile(rf"^{name}\b")).is_disabled()
    tab.keyboard.press("a")
    tab.wait_for_timeout(300)
    assert glance(third).state == "approved" and not lab.home._queue.busy


def test_an_export_is_of_the_clips_that_its_window_names(tab: "Tab", lab: Served):
    tab.locator(f"tr[data-key='{lab.key('set/d approved.tcfit')}']").get_by_role("checkbox").click()
    tab.keyboard.press("e")
    tab.get_by_role("dialog", name="Export").wait_for()
    tab.evaluate("""() => {
      const send = WebSocket.prototype.send;
      window.exported = "";
      WebSocket.prototype.send = function (text) {
        if (text.includes('"export"')) window.exported = text;
        else send.call(this, text);
      };
    }""")
    lab.home._tell([], [lab.key("set/d approved.tcfit")])  # the row goes while the window is open
    until(lambda: len(names(tab)) == 3)
    tab.get_by_role("button", name="Export").last.click()
    until(lambda: lab.key("set/d approved.tcfit") in tab.evaluate("window.exported"))


def test_a_typed_note_outlives_the_connection(tab: "Tab", lab: Served):
    folder = lab.home.catalogue.root / "set" / "b fitted.tcfit"
    tab.locator(f"tr[data-key='{lab.key('set/b fitted.tcfit')}']").click()
    tab.keyboard.press("n")
    tab.get_by_label("Note on walk").last.fill("typed on  a train")
    tab.evaluate("""() => {
      window.WebSocket = Object.assign(function () { return {}; }, { OPEN: 1 });
    }""")
    for watcher in list(lab.home._watchers):
        watcher.loop.call_soon_threadsafe(watcher.connection.transport.abort)
    until(lambda: "Not connected" in tab.locator("footer").inner_text())
    tab.keyboard.press("Enter")
    alert = tab.get_by_role("dialog").get_by_role("alert")
    until(lambda: "cannot be reached" in alert.inner_text())
    assert glance(folder).review.note != "typed on a train"
    tab.reload()  # this page's WebSocket is the test's
    tab.wait_for_selector("tr.clip")
    with Project.open(folder) as project:
        project.tell_who_works("carla")
        tab.locator(f"tr[data-key='{lab.key('set/b fitted.tcfit')}']").click()
        tab.keyboard.press("n")
        tab.get_by_label("Note on walk").last.fill("typed on  a train")
        tab.keyboard.press("Enter")
        until(lambda: "open in another tcfit" in alert.inner_text())
    tab.get_by_role("button", name="Save").click()
    until(lambda: glance(folder).review.note == "typed on a train")
    until(lambda: not tab.get_by_role("dialog").is_visible())


def test_exported_by_two_keys_with_the_formats_of_last_time(tab: "Tab", lab: Served):
    folder = lab.home.catalogue.root / "set" / "d approved.exports"
    tab.keyboard.press("End")
    tab.keyboard.press("e")
    tab.get_by_role("dialog", name="Export").wait_for()
    for title in ("Character (GLB)", "SMPL-X (npz)", "Skeleton (BVH)"):
        tab.get_by_label(title).uncheck()
    assert tab.get_by_role("button", name="Export").last.is_disabled()
    tab.get_by_label("Joints (CSV)").check()
    tab.get_by_role("button", name="Export").last.click()
    until(lambda: "Exported to d approved.exports" in tab.locator("tr.clip").last.inner_text())
    assert [path.name for path in folder.iterdir()] == ["walk.joints.csv"]
    (folder / "walk.joints.csv").unlink()
    tab.keyboard.press("c")
    until(lambda: "Exported" not in tab.locator("tr.clip").last.inner_text())
    tab.keyboard.press("e")
    tab.get_by_role("dialog", name="Export").wait_for()
    tab.keyboard.press("Enter")
    until(lambda: (folder / "walk.joints.csv").exists())
    until(lambda: "Exported" in tab.locator("tr.clip").last.inner_text())
    tab.keyboard.press("c")


def test_opened_gone_through_and_back(tab: "Tab", lab: Served):
    first, second = lab.key("set/c reviewed.tcfit"), lab.key("set/d approved.tcfit")
    tab.locator(f"tr[data-key='{first}'] a").click()
    tab.wait_for_url(f"**/clip/{first}")
    tab.wait_for_selector("html.tcfit-ready", state="attached", timeout=60_000)
    until(lambda: lab.home.reviews.viewers(first))
    tab.keyboard.press("Shift+O")
    until(lambda: glance(lab.home.catalogue.root / "set" / "c reviewed.tcfit").state == "approved")
    tab.keyboard.press("PageDown")
    tab.wait_for_url(f"**/clip/{second}*")
    tab.wait_for_selector("html.tcfit-ready", state="attached", timeout=60_000)
    until(lambda: lab.home.reviews.viewers(second) and not lab.home.reviews.viewers(first))
    tab.keyboard.press("Shift+Home")
    tab.wait_for_selector("tr.clip")
    until(lambda: tab.locator(":focus").get_attribute("data-key") == second)


@pytest.mark.parametrize("theme", ["dark", "light"])
def test_axe_finds_no_serious_fault(theme: str, tab: "Tab"):
    axe = pytest.importorskip("axe_playwright_python.sync_playwright", reason="axe-playwright-python is not installed")
    tab.emulate_media(color_scheme=theme)  # pyright: ignore[reportArgumentType]
    tab.keyboard.press("Control+a")
    tab.wait_for_timeout(400)
    found = axe.Axe().run(tab).response["violations"]
    grave = [fault for fault in found if fault["impact"] in ("serious", "critical")]
    assert [f"{fault['id']}: {node['html'][:200]}" for fault in grave for node in fault["nodes"]] == []


def test_of_many_clips_only_those_in_sight_are_in_the_page(tab: "Tab"):
    tab.evaluate(
        """async () => {
          const { Table } = await import("/tcfit/home/table.js");
          const box = document.querySelector("main");
          const rows = Array.from({ length: 5000 }, (_, i) => (
            { key: String(i).padStart(12, "0"), name: `clip ${i}`, place: `clip ${i}`, kind: "project" }));
          box.replaceChildren();
          const table = new Table(box, { sort() {}, look() {} });
          table.show({ rows, selected: new Set(), current: null, sort: { by: "name", down: false } });
          box.scrollTop = 72 * 4000;
        }"""
    )
    until(lambda: "clip 4001" in names(tab))
    assert len(names(tab)) < 40
    assert tab.locator("table").get_attribute("aria-rowcount") == "5001"
