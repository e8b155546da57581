"""How quick the review app is in a real browser: opening, seeking, and a keypoint that is dragged with its fit.

`tcfit review` runs as users run it, in a process of its own, on a fitted project; Debian's Chromium, with WebGL in
software, opens the link. A frame counts as there when its picture has gone to the graphics card, a body when its
vertices have; "drawn" is when the card, here the processor, has finished the picture's frame. Times are the browser's
own: from the key or pointer event to that moment.
"""

import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from tyro.conf import OmitArgPrefixes

from benchmarks.report import Common, Row, progress, repeated, report, start
from fitting_core.clips.reading import read_footage
from fitting_core.detect.detecting import Detection
from fitting_core.detect.detectors import DEFAULT, find_detector
from fitting_core.errors import InputError
from fitting_core.keypoints import INDEX
from fitting_core.video.frames import FrameSource
from tcfit_app.project.project import Project
from tests.drivers.browser import chromium

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

SETTLED_MS = 600
"""Without anything new for so long, the page has come to rest."""
SAME_BODY_MS = 5.0
"""A body's positions and normals go to the graphics card one after the other."""
HOOKS = """
window.__picture = []; window.__mesh = []; window.__drawn = [];
const whenDrawn = (gl) => queueMicrotask(() => {
  const fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
  gl.flush();
  const look = () => {
    if (gl.getSyncParameter(fence, gl.SYNC_STATUS) === gl.SIGNALED) window.__drawn.push(performance.now());
    else setTimeout(look, 1);
  };
  look();
});
for (const name of ["texImage2D", "texSubImage2D", "texStorage2D"]) {
  const plain = WebGL2RenderingContext.prototype[name];
  WebGL2RenderingContext.prototype[name] = function(...args) {
    const source = args[args.length - 1];
    if (source && (source.width > 200 || source.byteLength > 1e5)) {
      window.__picture.push(performance.now());
      whenDrawn(this);
    }
    return plain.apply(this, args);
  };
}
for (const name of ["bufferData", "bufferSubData"]) {
  const plain = WebGL2RenderingContext.prototype[name];
  WebGL2RenderingContext.prototype[name] = function(...args) {
    if (args.some((a) => a && a.byteLength > 5e4)) window.__mesh.push(performance.now());
    return plain.apply(this, args);
  };
}
"""
"""Note when pictures and vertices go to the graphics card, and when it has drawn a picture."""
NEXT_MOVE = """() => {
  window.__mesh.length = 0;
  const note = () => { window.__at = performance.now(); };
  window.addEventListener("pointermove", note, { once: true, capture: true });
}"""
"""Note when the next move of the pointer arrives in the page."""
AT_REST = """async (still) => {
  while (performance.now() - Math.max(...window.__mesh, window.__at) < still)
    await new Promise((go) => setTimeout(go, 20));
}"""
"""Until no body has come for some milliseconds."""
LATER = """async ([list, since]) => {
  const end = performance.now() + 5000;
  while (performance.now() < end) {
    const found = window[list].find((t) => t > since);
    if (found) return found - since;
    await new Promise((go) => setTimeout(go, 2));
  }
  return null;
}"""


@dataclass(frozen=True, kw_only=True)
class Review:
    """What to measure on."""

    project: Path
    """A project with a finished fit; it is copied."""
    openings: int = 5
    """How often the app is started for the first figure, and once before."""
    seeks: int = 40
    moves: int = 40
    keypoint: str = "right_wrist"
    """Which one is dragged."""
    window: tuple[int, int] = (1440, 900)
    plays: float = 20.0
    """Seconds of playback from the clip's beginning."""
    videos: tuple[Path, ...] = ()
    """Plain videos; for each: from the button that finds keypoints and fits to the first body."""
    side: bool = True
    """With the side view beside the picture, as it is at first."""
    common: OmitArgPrefixes[Common] = field(default_factory=Common)


@contextmanager
def served(project: Path) -> Iterator[tuple[str, float]]:
    """A review in a process of its own: its link, and when it was started."""
    begun = time.perf_counter()
    command = [sys.executable, "-m", "tcfit_app", "review", str(project), "--port", "0", "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            link = next((line for line in process.stdout if line.startswith("Review:")), "")
            if not link:
                raise InputError(f"tcfit review ended with {process.wait()}; its messages stand above.")
            yield link.removeprefix("Review:").strip(), begun
        finally:
            process.send_signal(signal.SIGINT)  # as Ctrl-C: it leaves what the next opening shows first


def seeks(page: "Page", count: int) -> tuple[list[float], list[float]]:
    """Milliseconds from the key to the next frame's picture, sent and drawn: forward by one, then the page rests."""
    sent, drawn = [], []
    for _ in range(count):
        page.evaluate("() => { window.__picture.length = window.__drawn.length = 0; window.__at = performance.now(); }")
        page.keyboard.press("ArrowRight")
        since = page.evaluate("() => window.__at")
        for name, times in (("__picture", sent), ("__drawn", drawn)):
            found = page.evaluate(LATER, [name, since])
            if found is not None:
                times.append(found)
        page.wait_for_timeout(SETTLED_MS)
    return sent, drawn


def drags(page: "Page", place: tuple[float, float], count: int) -> list[float]:
    """Milliseconds from a move of the pressed pointer to the next body; the page rests in between."""
    x, y = place
    page.mouse.move(x, y)
    page.wait_for_timeout(SETTLED_MS)
    page.mouse.down()
    times = []
    for i in range(count + 1):
        page.evaluate(NEXT_MOVE)
        page.mouse.move(x - 6 - 2 * i, y - 6 - i)
        found = page.evaluate(LATER, ["__mesh", page.evaluate("() => window.__at")])
        if found is not None and i > 0:  # the first one prepares the correction
            times.append(found)
        page.evaluate(AT_REST, SETTLED_MS)
    page.mouse.up()
    return times


def starts(page: "Page", place: tuple[float, float], count: int) -> list[float]:
    """Milliseconds from the first move of a pressed pointer to the first body; the fit comes to its end in between."""
    x, y = place
    times = []
    for i in range(count):
        page.mouse.move(x, y)
        page.wait_for_timeout(SETTLED_MS)
        page.mouse.down()
        page.evaluate(NEXT_MOVE)
        x, y = x - 6 * (-1) ** i, y - 4 * (-1) ** i
        page.mouse.move(x, y)
        found = page.evaluate(LATER, ["__mesh", page.evaluate("() => window.__at")])
        if found is not None:
            times.append(found)
        page.mouse.up()
        page.evaluate(AT_REST, SETTLED_MS)
        page.wait_for_timeout(1000)
    return times


def rapid(page: "Page", place: tuple[float, float], count: int) -> list[float]:
    """Milliseconds between bodies while the pointer never rests."""
    x, y = place
    page.mouse.move(x, y)
    page.mouse.down()
    page.evaluate("() => { window.__mesh.length = 0; }")
    for i in range(4 * count):
        page.mouse.move(x - 6 - i % 40, y - 6 - i % 30)
        page.wait_for_timeout(16)
    times = np.diff(page.evaluate("() => window.__mesh"))
    page.mouse.up()
    return times[times > SAME_BODY_MS].tolist()


def streamed(page: "Page") -> list[float]:
    """Milliseconds from "Fit everything" to the first body of the new fit, seen in the clip's first frame."""
    page.keyboard.press("Home")
    page.wait_for_timeout(2 * SETTLED_MS)
    page.evaluate("() => { window.__mesh.length = 0; window.__at = performance.now(); }")
    page.keyboard.press("Shift+R")
    found = page.evaluate(LATER, ["__mesh", page.evaluate("() => window.__at")])
    return [] if found is None else [found]


def playback(page: "Page", seconds: float) -> tuple[list[float], list[float]]:
    """Milliseconds between pictures and between bodies while the clip is played in real time."""
    page.keyboard.press("Home")
    page.wait_for_timeout(2 * SETTLED_MS)
    page.evaluate("() => { window.__picture.length = window.__mesh.length = 0; }")
    page.keyboard.press("Space")
    page.wait_for_timeout(1000 * seconds)
    pictures, bodies = (np.diff(times) for times in page.evaluate("() => [window.__picture, window.__mesh]"))
    page.keyboard.press("Space")
    return pictures[pictures > SAME_BODY_MS].tolist(), bodies[bodies > SAME_BODY_MS].tolist()


def summary(what: str, times: list[float], target: str) -> Row:
    """A line of the table; milliseconds."""
    return repeated(what, times) | {"target": target}


def on_screen(page: "Page", project: Path, frame: int, keypoint: str) -> tuple[float, float]:
    """Where a keypoint is in the window, by the page's own projection."""
    with Project.open(project, read_only=True) as opened:
        xy = opened.corrected.xy[frame, INDEX[keypoint]].tolist()
    return tuple(page.evaluate("([x, y]) => tcfit.place(x, y)", xy))


def first_frame(page: "Page", link: str) -> None:
    """Opens the app, and waits for the frame's picture and the body."""
    page.goto(link)
    page.wait_for_function("() => window.__picture.length > 0 && window.__mesh.length > 0", timeout=60_000)


def opening(browser: "Browser", project: Path, window: tuple[int, int]) -> float:
    """Milliseconds from the start of the program to the first frame with its body."""
    page = new_page(browser, window)
    with served(project) as (link, begun):
        first_frame(page, link)
        took = 1e3 * (time.perf_counter() - begun)
        page.wait_for_selector("html.tcfit-ready", state="attached", timeout=60_000)
    page.close()
    return took


def from_a_video(browser: "Browser", video: Path, folder: Path, window: tuple[int, int]) -> float:
    """Milliseconds from the button that finds keypoints and fits to the first body."""
    clip = read_footage(video)
    with FrameSource(video) as source:
        Detection(source=source, frames=range(len(clip)), detector=find_detector(DEFAULT)).store().discard()
    Project.create(folder, clip).close()
    page = new_page(browser, window)
    with served(folder) as (link, _):
        page.goto(link)
        button = page.get_by_text("Find keypoints and fit")
        button.wait_for(timeout=60_000)
        page.wait_for_timeout(5000)
        page.evaluate("() => { window.__mesh.length = 0; window.__at = performance.now(); }")
        button.click()
        page.wait_for_function("() => window.__mesh.length > 0", timeout=60_000)
        took = page.evaluate("() => window.__mesh[0] - window.__at")
    page.close()
    return took


def new_page(browser: "Browser", window: tuple[int, int]) -> "Page":
    """An empty tab of some size that notes what is drawn."""
    page = browser.new_page(viewport={"width": window[0], "height": window[1]})
    page.add_init_script(HOOKS)
    return page


def run(options: Review) -> None:
    """Measures and prints a table."""
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as folder, chromium() as browser:
        project = Path(shutil.copytree(options.project, Path(folder) / "copy.tcfit"))
        _, *opened = [opening(browser, project, options.window) for _ in range(1 + options.openings)]
        rows.append(summary("from the command to the first frame and its body", opened, "5000"))
        progress("opened")
        for number, video in enumerate(options.videos):
            found = from_a_video(browser, video, Path(folder) / f"{number}.tcfit", options.window)
            rows.append(summary(f"{video.parent.name}, keypoints and fit: button to first body", [found], "2000"))
        page = new_page(browser, options.window)
        with served(project) as (link, _):
            first_frame(page, link)
            page.wait_for_timeout(5000)
            page.evaluate(
                "() => document.querySelectorAll('.mantine-Notification-closeButton').forEach((b) => b.click())"
            )
            if not options.side:
                page.keyboard.press("v")
            page.wait_for_timeout(1000)
            sent, drawn = seeks(page, options.seeks)
            rows.append(summary("seek: key to picture", sent, "median 150"))
            rows.append(summary("seek: key to drawn picture", drawn, "median 150"))
            progress("seeks")
            place = on_screen(page, project, options.seeks, options.keypoint)
            first, *later = starts(page, place, 9)
            rows.append(summary("the first drag: pointer to first body", [first], ""))
            rows.append(summary("later drags: pointer to first body", later, ""))
            page.wait_for_timeout(4000)
            place = on_screen(page, project, options.seeks, options.keypoint)
            rows.append(summary("drag: pointer to body", drags(page, place, options.moves), "median 150, 95 % 300"))
            page.wait_for_timeout(4000)
            place = on_screen(page, project, options.seeks, options.keypoint)
            rows.append(summary("drag without rest: body to body", rapid(page, place, options.moves), ""))
            page.wait_for_timeout(4000)
            pictures, bodies = playback(page, options.plays)
            rows.append(summary("playback: picture to picture", pictures, ""))
            rows.append(summary("playback: body to body", bodies, ""))
            rows.append(summary("Fit everything: key to first body", streamed(page), "2000"))
    report(options, {"Review app": rows})


if __name__ == "__main__":
    start(Review, run)
