"""What users do, and what goes wrong meanwhile, at random."""

import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any
from unittest.mock import MagicMock

import numpy as np

from fitting_core.errors import InputError
from fitting_core.fit.phases import independent
from fitting_core.io.cameras.reading import CameraFile
from fitting_core.keypoints import BODY
from tcfit_app.analysis import suspicion
from tcfit_app.fitting import jobs, live
from tcfit_app.imports.results import ImportChoices
from tcfit_app.project.edits.kinds import Edit, MarkBad
from tcfit_app.project.edits.remarks import WriteNote
from tcfit_app.project.storage import changes, run_files, runs
from tcfit_app.review.browser import page_events
from tcfit_app.review.gestures.actions import ACTIONS
from tests.drivers.lone_page import call_back
from tests.flows.world import TABS, World
from tests.samples.project_samples import random_edit, sample_view
from tests.samples.sessions import FRAMES, QUICK

_NOT_HERE = ("fit", "list", "next_clip", "previous_clip")
"""Actions that need a page, or take long with the default settings."""
NAMES = [name for name in ACTIONS if name not in _NOT_HERE and not name.startswith(("detect_", "frame_"))]
OFTEN = ("undo", "undo", "undo", "redo", "bad", "nudge10_left", "flag", "fine", "reset", "approve", "rerun", "cancel")


@dataclass(frozen=True)
class Act:
    """What a user does, from a tab."""

    world: World
    rng: np.random.Generator
    tab: str

    def frame(self) -> int:
        """A frame of the clip."""
        return int(self.rng.integers(FRAMES))

    def send(self, *events: page_events.PageEvent) -> None:
        """Events of the tab's page."""
        self.world.send(self.tab, *events)

    def do(self, command: Callable[[], object]) -> None:
        """A command of the tab's panels."""

        def done() -> None:
            command()

        self.world.page(self.tab).tab.do(done)
        self.world.turn()

    def aside(self, title: str, work: Callable[[], Any]) -> None:
        """Slow work that changes the project, as panels begin it."""
        page = self.world.page(self.tab)
        page.tab.begin(title, lambda report: work(), lambda found: None, writes=True)


def select(act: Act) -> None:
    """Go to a frame, and select keypoints there and at times frames around."""
    joints = tuple(int(joint) for joint in act.rng.choice(BODY.stop, size=act.rng.integers(1, 4), replace=False))
    act.send(page_events.Seek(frame=act.frame()), page_events.Select(joints=joints, how="replace"))
    if act.rng.random() < 0.3:
        first = act.frame()
        act.send(page_events.Range(first=first, last=min(first + 2, FRAMES - 1)))


def key(act: Act, names: tuple[str, ...] = ()) -> None:
    """An action, by key, menu or palette."""
    name = str(act.rng.choice(names or NAMES))
    if name in ACTIONS:
        act.send(page_events.Key(action=name, repeat=False))


def edit(act: Act) -> None:
    """Any kind of edit, without the gesture that makes it; every eighth is one of another view."""
    session, page, number = act.world.session, act.world.page(act.tab), int(act.rng.integers(10_000))
    project, views = session.project, session.project.views
    if number % 8 == 0 and not views:
        made = sample_view(project.footage, name="b", count=FRAMES)
        return act.do(lambda: project.add_view(made, author=page.tab.author))
    if number % 24 == 0:
        one: Edit = project.removal_of_view(views[0].id)
    elif number % 8 == 0:
        mark = MarkBad(frames=(number % FRAMES,), joints=(number % BODY.stop,))
        one = project.edit_of_view(views[0].id, mark)
    else:
        one = random_edit(number)
    act.do(lambda: session.edit(one, author=page.tab.author, shown=page.tab.look().b))


def drag(act: Act) -> None:
    """Drag keypoints in the image; at times the drag is given up, or its tab is lost in the middle."""
    joints, frame = (int(act.rng.integers(BODY.stop)),), act.frame()
    dx, dy = act.rng.normal(0, 20, 2).tolist()
    dragged = partial(page_events.Drag, joints=joints, frame=frame)
    act.send(page_events.Seek(frame=frame), dragged(phase="start", dx=0.0, dy=0.0))
    act.send(dragged(phase="move", dx=dx, dy=dy))
    how = act.rng.random()
    if how < 0.1:
        return reload(act)
    act.send(dragged(phase="cancel" if how < 0.2 else "end", dx=dx, dy=dy))


def drag_in_depth(act: Act) -> None:
    """Drag a keypoint of the fit in the side view."""
    joint, frame, metres = int(act.rng.integers(25)), act.frame(), float(act.rng.normal(0, 0.2))
    dragged = partial(page_events.DragDepth, joint=joint, frame=frame, metres=metres)
    act.send(page_events.Seek(frame=frame), dragged(phase="start"))
    act.send(dragged(phase="move"), dragged(phase="end"))


def fit(act: Act) -> None:
    """A whole fit."""
    act.do(lambda: act.world.session.fit_everything(QUICK, kind="smplx", gender="neutral"))


def rerun(act: Act) -> None:
    """Some frames or the shape again, of the fit on show."""
    page, session = act.world.page(act.tab), act.world.session
    shown, first = page.tab.look().b, act.frame()
    if shown is None:
        return
    windows = (range(first, min(first + 3, FRAMES)),)
    again = act.rng.random() < 0.6
    act.do(lambda: session.rerun_frames(shown, QUICK, windows) if again else session.rerun_shape(shown, QUICK))


def runs_list(act: Act) -> None:
    """Rename, delete, restore or purge runs."""
    session = act.world.session
    everything = [*session.project.runs.all(), *session.project.runs.all(deleted=True)]
    if not everything:
        return
    run = everything[int(act.rng.integers(len(everything)))]
    commands: list[Callable[[], object]] = [
        lambda: session.project.runs.rename(run.id, f"run {act.rng.integers(100)}"),
        lambda: session.project.runs.undelete(run.id) if run.deleted else session.delete(run.id),
        lambda: session.cancel(run.id),
        lambda: session.project.runs.purge(),
    ]
    act.do(commands[int(act.rng.choice(4, p=[0.3, 0.4, 0.25, 0.05]))])


def setting(act: Act) -> None:
    """Some input of a panel gets another value, which may be nonsense."""
    handles = [
        handle
        for handle in act.world.page(act.tab).tab.client.gui._gui_input_handle_from_uuid.values()
        if getattr(handle, "label", "") and handle._impl.update_cb
    ]
    if not handles:
        return
    handle = handles[int(act.rng.integers(len(handles)))]
    options = getattr(handle, "options", None)
    if options:
        value: Any = options[int(act.rng.integers(len(options)))]
    elif isinstance(handle.value, bool):
        value = not handle.value
    elif isinstance(handle.value, str):
        value = str(act.rng.choice(["", "5", "-1", "0.5", "100", "nonsense", handle.value]))
    else:
        return
    handle._impl.value = value
    call_back(handle, MagicMock())
    act.world.turn()


def press(act: Act) -> None:
    """Some button that a panel shows."""
    buttons = act.world.page(act.tab).tab.buttons
    there = sorted(frozenset[tuple[str, str]]().union(*buttons._shown.values()))
    there = [button for button in there if not (button[0] == "action" and button[1] in _NOT_HERE)]
    if there:
        command, value = there[int(act.rng.integers(len(there)))]
        act.send(page_events.Press(command=command, value=value))


def export(act: Act) -> None:
    """A file of a fit."""
    act.send(page_events.Key(action=f"export_{act.rng.choice(['joints', 'npz', 'bvh'])}", repeat=False))


def import_result(act: Act) -> None:
    """Another program's result becomes a run."""
    session, path = act.world.session, act.world.folder / "smplifyx"
    act.aside("Import", lambda: session.import_run(path, ImportChoices(), lambda text, share: None))


def lens(act: Act) -> None:
    """A calibration with another focal length, or with another lens."""
    session, path = act.world.session, act.world.folder / "camera.yaml"
    size, focal = session.project.footage.camera.size, float(act.rng.uniform(600, 900))
    k1 = float(act.rng.choice([0.0, -0.1]))
    path.write_text(
        f"image_width: {size[0]}\nimage_height: {size[1]}\ncamera_name: cam\n"
        "camera_matrix:\n  rows: 3\n  cols: 3\n"
        f"  data: [{focal}, 0, {size[0] / 2}, 0, {focal}, {size[1] / 2}, 0, 0, 1]\n"
        "distortion_model: plumb_bob\n"
        f"distortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [{k1}, 0, 0, 0, 0]\n"
    )
    act.aside("Camera", lambda: session.set_camera(CameraFile(path=path)))


def note(act: Act) -> None:
    """Something said of frames or the clip."""
    page, session = act.world.page(act.tab), act.world.session
    frame, text = act.frame(), f"note {act.rng.integers(100)}"
    act.do(lambda: session.project.append(WriteNote(frames=(frame,), text=text), author=page.tab.author))


def switch(act: Act) -> None:
    """Go to the other clip."""
    act.world.switch()


def reload(act: Act) -> None:
    """The tab is reloaded, or has lost its connection for a while."""
    act.world.disconnect(act.tab)
    for _ in range(int(act.rng.integers(3))):
        act.world.turn()
    act.world.connect(act.tab)


def rest(act: Act) -> None:
    """Wait until everything has been done, or only a little."""
    if act.rng.random() < 0.5:
        act.world.until(lambda: act.world.idle, "jobs, edits to be followed and tasks")
    else:
        for _ in range(3):
            act.world.turn()


EXPORTED = ("joints", "npz", "bvh", "figures")
ACTS: list[tuple[float, Callable[[Act], None]]] = [
    (0.12, select),
    (0.06, key),
    (0.16, partial(key, names=OFTEN)),
    (0.1, edit),
    (0.1, drag),
    (0.05, drag_in_depth),
    (0.05, fit),
    (0.05, rerun),
    (0.05, runs_list),
    (0.04, setting),
    (0.05, press),
    (0.02, export),
    (0.03, import_result),
    (0.02, lens),
    (0.02, note),
    (0.03, switch),
    (0.03, reload),
    (0.06, rest),
]


# --- faults ---


class Bomb(RuntimeError):
    """An exception that no code expects."""


def full_disk(act: Act) -> str:
    """The disk is full after some more writes."""
    act.world.disk.room = int(act.rng.integers(8))
    return f"disk full after {act.world.disk.room} writes"


def killed(act: Act) -> str:
    """The process is killed after some more writes."""
    writes = int(act.rng.integers(8))
    act.world.kill_at(writes)
    return f"killed after {writes} writes"


def lost_connection(act: Act) -> str:
    """Both tabs lose their connection."""
    for tab in TABS:
        act.world.disconnect(tab)
    act.world.turn()
    for tab in TABS:
        act.world.connect(tab)
    return "both tabs lost their connection"


TARGETS: list[tuple[Any, str]] = [
    (jobs, "fit_events"),
    (jobs, "refit_events"),
    (jobs, "shape_events"),
    (live, "rerun_events"),
    (live.LiveCorrection, "resolve"),
    (independent, "fit_frames"),
    (run_files, "phase_arrays"),
    (runs, "write_run"),
    (runs, "read_run"),
    (changes.Changes, "add"),
    (changes.Changes, "_read"),
    (suspicion, "review_queue"),
]
"""Functions of other threads that fail once."""


def exception(act: Act) -> str:
    """A function fails, once, in whichever thread calls it next."""
    owner, name = TARGETS[int(act.rng.integers(len(TARGETS)))]
    real = getattr(owner, name)

    def fail(*given: Any, **named: Any) -> Any:
        setattr(owner, name, real)
        raise Bomb(f"in {name}")

    setattr(owner, name, fail)
    act.world.mend.append(lambda: setattr(owner, name, real))
    return f"exception in {name}"


def hostile_file(act: Act) -> str:
    """Something odd lies in the project's folder or beside it."""
    project = act.world.project.folder
    places = [
        project / "runs" / "000009.npz",
        project / "runs" / "000002",
        project / "reference.npz",
        project / "handshapes.toml",
        project.parent / "odd",
        project / "runs" / ".000002.npz.partial",
        Path(os.fsdecode(os.fsencode(project.parent) + b"/\xff\xfe")),
    ]
    place = places[int(act.rng.integers(len(places)))]
    kind = str(act.rng.choice(["pipe", "folder", "text", "link"]))
    if not os.path.lexists(place):
        make = {
            "pipe": lambda: os.mkfifo(place),
            "folder": lambda: place.mkdir(),
            "text": lambda: place.write_bytes(b"\x00garbage"),
            "link": lambda: place.symlink_to("/dev/zero"),
        }
        make[kind]()
    return f"{kind} at {place.relative_to(project.parent)!r}"


FAULTS: list[Callable[[Act], str]] = [full_disk, full_disk, killed, lost_connection, exception, hostile_file]


def ignored(error: BaseException) -> bool:
    """Whether an action may fail so: it was told what is wrong."""
    return isinstance(error, InputError | Bomb)
