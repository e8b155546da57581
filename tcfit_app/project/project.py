"""A project on disk: a clip, all corrections of its keypoints, all fits, and the review.

A project is a folder:

| file | |
|---|---|
| project.sqlite | clip, log of edits, marks and notes, runs and settings (`storage/database.py` has the tables) |
| detections.npz | the detected keypoints, xy (T, 137, 2) in pixels, confidence (T, 137), and the detector; never \
changed once there are any |
| runs/000001.npz | a run's result (`storage/run_files.py` has the keys) |
| runs/000002/000001.npz | a change of a run of corrections (`storage/changes.py`) |
| runs/000003.partial.npz | the frames that the interrupted first phase of a run has fitted |
| reference.npz | the reference that fits are compared with, if any |
| handshapes.toml | the user's own set of handshapes, if any |
| media/ | the videos or images, if they were copied; otherwise the database has their paths |
| opening.npz | the body that the project opens with (`storage/opening_body.py`) |
| project.lock | held by the writing process |

When a method that changes something returns, the change is on disk. After a crash, the project opens as if it had been
closed after the last such return.
"""

import threading
from bisect import bisect_right
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from datetime import UTC, datetime
from itertools import islice
from pathlib import Path
from types import TracebackType

import msgspec
import numpy as np
from jaxtyping import Bool

from fitting_core.camera import Camera
from fitting_core.clip import Clip, OtherView
from fitting_core.errors import InputError
from fitting_core.files.atomic import replacing, sweep, sweep_beside
from fitting_core.fit.views.relating import related
from fitting_core.io.people_file import refuse_several
from fitting_core.keypoints import KeptOffset, Keypoints
from fitting_core.lens import filmed_keypoints, straightened_keypoints
from fitting_core.measure.references.files import read_reference
from fitting_core.measure.references.reference import Reference, write_reference
from fitting_core.silhouettes import Silhouettes
from tcfit_app.project.edits.corrected import Corrected
from tcfit_app.project.edits.edit_log import (
    EditHistory,
    LogAction,
    LogEntry,
    Marking,
    Redo,
    Said,
    Undo,
    decode,
    encode,
    frames_changed,
)
from tcfit_app.project.edits.kinds import AddView, EditView, KeypointEdit, RemoveView, check
from tcfit_app.project.edits.remarks import Note, Remark
from tcfit_app.project.edits.standing import Standing
from tcfit_app.project.other_view import ProjectView
from tcfit_app.project.storage import database, media
from tcfit_app.project.storage.accessing import accessing, creating
from tcfit_app.project.storage.clip import (
    read_clip,
    read_height,
    replace_camera,
    replace_detections,
    replace_height,
    write_clip,
)
from tcfit_app.project.storage.clip_review import ReviewOfClip
from tcfit_app.project.storage.columns import Columns, Count, of, text, time
from tcfit_app.project.storage.database import Database
from tcfit_app.project.storage.lock import ProjectLock
from tcfit_app.project.storage.marks import MarkStore
from tcfit_app.project.storage.media import Media, MediaLink
from tcfit_app.project.storage.names import name_of_file
from tcfit_app.project.storage.opening_body import OpeningBody, write_opening_body
from tcfit_app.project.storage.runs import Runs
from tcfit_app.project.storage.view_media import store_view_link, view_links

_REMOVED = ('{"kind":"take_rotations"',)
"""Beginnings of edits that only earlier versions made. They stay in the log, and are ignored."""
_REFERENCE = "reference.npz"
_REPLACING = "The keypoints are being replaced, because the lens or the person has changed. Try again in a moment."


class Project:
    """An open project; a context manager. Thread-safe."""

    def __init__(self, folder: Path, store: Database, held: ProjectLock | None) -> None:
        """Use `create` or `open`."""
        self.folder = folder
        stored, link = read_clip(folder, store)
        self.media: Media = media.find(link, folder)
        """Where the video or images were found on opening, and what is wrong with them."""
        self.runs = Runs(folder, store, len(stored), stored.first_frame, lambda: self.standing)
        self.marks = MarkStore(
            store, len(stored), self._marks_done, lambda action, author: self.append(action, author=author)
        )
        links = view_links(store.rows, store.damage)
        self._view_media = {view: media.find(link, folder) for view, link in links.items()}
        self._views: tuple[ProjectView, ...] = ()
        self._stored, self._database, self._lock = stored, store, held
        self.review = ReviewOfClip(store, lambda: self.last_edit)
        """Of the clip as a whole: see `ClipReview`."""
        self.keypoints_version = self.marks_version = self.video_version = 0
        """Versions: they change with the keypoints, the marks and notes, and the video frames."""
        self.height = read_height(store)
        """Height of the person without shoes, centimetres; None: unknown. See `set_height`."""
        self._clip: Clip | None = None
        self._footage: Clip | None = None
        self._detected = bool((stored.keypoints.confidence > 0).any())
        self._guard = threading.RLock()
        """Guards the project's state; held only briefly, because the drawing thread needs it."""
        self._changing_files = threading.Lock()
        """Guards slower operations: replacing detections, video or reference."""
        self._reference: Reference | None = None
        self._looked = False
        if held:
            with accessing(folder):
                sweep(folder)
                sweep_beside(folder)
            self.runs.recover()
        senseless: set[int] = set()

        def leave_out(entry: LogEntry, why: InputError) -> None:
            store.damage.note(f"edit {entry.id} is invalid ({why})")
            senseless.add(entry.id)

        log = _readable_log(store)
        self._history = EditHistory(stored.keypoints, log, first_frame=stored.first_frame, leave_out=leave_out)
        self._log = [entry for entry in log if entry.id not in senseless]

    @property
    def damage(self) -> tuple[str, ...]:
        """Rows of the database that are damaged and left out; may grow as more is read."""
        return self._database.damage.found

    @staticmethod
    def create(
        folder: Path, clip: Clip, *, copy_media: bool = False, begin: Callable[["Project"], None] | None = None
    ) -> "Project":
        """Create a project and open it. Raises InputError if the folder is not empty or cannot be written, or the
        source cannot be read; nothing is left there then.

        Args:
            folder: Must not exist, or be empty.
            clip: Its keypoints become the detections, its source the project's media; its other views are related to
                it.
            copy_media: Copy the sources into the project; otherwise they are linked.
            begin: Writes what must be in it before it becomes visible; its errors are raised.
        """
        folder, link = folder.resolve(), None
        with creating(folder) as draft:
            if clip.source:
                link = media.copy(clip.source, draft) if copy_media else media.link(clip.source, folder)
            write_clip(draft, clip, link=link)
            if begin is not None or clip.views:
                with Project.open(draft) as project:
                    for view in clip.views:
                        project.add_view(view, copy_media=copy_media, linked_from=folder)
                    if begin is not None:
                        begin(project)
        return Project.open(folder)

    @staticmethod
    def open(folder: Path, *, read_only: bool = False) -> "Project":
        """Open a project. There can be one writer and any number of readers at a time.

        A reader sees edits and remarks as of its opening, but runs as they are now.

        Raises:
            ProjectLocked: Another process is writing; the project can be opened read-only.
            InputError: It is not a project, is damaged, comes from a newer tcfit, or cannot be written.
        """
        with accessing(folder):
            if not (folder / database.NAME).is_file():
                refuse_several(folder)
                raise InputError(f"{folder}: not a tcfit project: it has no {database.NAME}. `tcfit new` creates one.")
            held = None if read_only else ProjectLock(folder)
        store = None
        try:
            store = Database(folder / database.NAME, read_only=read_only)
            return Project(folder, store, held)
        except BaseException:
            if store:
                store.close()
            if held:
                held.release()
            raise

    @property
    def read_only(self) -> bool:
        """Whether nothing can be changed."""
        return self._lock is None

    def refuse_read_only(self) -> None:
        """Raise InputError if nothing can be changed."""
        if self.read_only:
            raise InputError(database.read_only_refusal(self.folder))

    def tell_who_works(self, names: str) -> None:
        """Tell other processes who works on it."""
        if self._lock is not None:
            self._lock.tell(names)

    def keep_opening_body(self, body: OpeningBody) -> None:
        """Store what the project opens with. Raises InputError if it cannot be written."""
        write_opening_body(self.folder, self._database, body)

    @property
    def detections(self) -> Keypoints:
        """The detections, in read-only arrays."""
        return self._stored.keypoints

    @property
    def detected(self) -> Corrected:
        """The base of corrections: the detections, as replaced by take-overs and second looks. Like `corrected`, a view
        that reflects later edits."""
        with self._guard:
            return self._history.detected

    @property
    def exchanges(self) -> list[LogEntry]:
        """Keypoints taken over from other people of the clip, oldest first."""
        with self._guard:
            return self._history.exchanges

    @property
    def kept(self) -> tuple[KeptOffset, ...]:
        """The current offsets, also in `clip.keypoints`, which take longer."""
        with self._guard:
            return self._history.kept

    @property
    def corrected(self) -> Corrected:
        """The current keypoints, with which were edited and which are bad; for the thread that edits, because it is a
        view that reflects later edits."""
        with self._guard:
            return self._history.corrected

    def marked(self, marking: Marking) -> list[int]:
        """The frames with any keypoint for which this holds, in order."""
        with self._guard:
            return self._history.marked(marking)

    @property
    def bad(self) -> Bool[np.ndarray, "T 137"]:
        """Which keypoints are marked bad."""
        bad = np.zeros(self._stored.keypoints.confidence.shape, bool)
        with self._guard:
            frames = self._history.marked("bad")
            bad[frames] = self._history.corrected.bad[frames]
        return bad

    @property
    def footage(self) -> Clip:
        """The clip as filmed and detected, with the source's current path: for callers that do not need corrected
        keypoints, which take longer after an edit."""
        with self._guard:
            if self._footage is None or self._footage.source != self.media.path:
                self._footage = replace(self._stored, source=self.media.path)
            return self._footage

    @property
    def clip(self) -> Clip:
        """The clip to fit now: corrected keypoints, other views, and the source's current path."""
        with self._guard:
            now, footage = self._clip, self.footage
            keypoints, views = self._history.keypoints, tuple(one.seen_by(footage.camera) for one in self.views)
            if now is None or now.keypoints is not keypoints or (now.views, now.source) != (views, footage.source):
                self._clip = now = replace(footage, keypoints=keypoints, views=views)
            return now

    def clip_by(self, camera: Camera) -> Clip:
        """The same with another camera, such as a run's."""
        with self._guard:
            return replace(self.clip, camera=camera, views=tuple(one.seen_by(camera) for one in self.views))

    def related_clip(self, camera: Camera) -> Clip:
        """The same, with other views related to it. Slow if that camera is new. Raises InputError if a view does not
        match then."""
        with self._guard:
            views, clip = self.views, self.clip_by(camera)
        found = related(clip)
        for one, view in zip(views, found.views, strict=True):
            one.remember(camera, view)
        return found

    # --- other views ---

    @property
    def views(self) -> tuple[ProjectView, ...]:
        """Other views of the person, in the order in which they were added."""
        with self._guard:
            known = {view.standing: view for view in self._views}
            unknown = Media(path=None, problem="This view has no video.")
            found = list[ProjectView]()
            for standing in self._history.views:
                there, before = self._view_media.get(standing.id, unknown), known.get(standing)
                same = before is not None and before.media == there
                found.append(before if same and before else ProjectView(standing=standing, media=there))
            self._views = tuple(found)
            return self._views

    def add_view(
        self, view: OtherView, *, copy_media: bool = False, author: str = "", linked_from: Path | None = None
    ) -> LogEntry:
        """Add another view, an edit like others. Raises InputError as `append`, or if its video cannot be read.

        Args:
            view: With its relation to the clip.
            copy_media: Copy its video into the project; otherwise it is linked.
            author: Who adds it.
            linked_from: The folder that the link is relative to, if the project will be moved there.
        """
        self.refuse_read_only()
        with self._changing_files:
            source, link = view.clip.source, None
            if source is not None:
                link = media.copy(source, self.folder) if copy_media else media.link(source, linked_from or self.folder)
            named = replace(view, clip=replace(view.clip, name=name_of_file(view.clip.name)))
            return self.append(AddView.of(named, self.footage), author=author, video=link)

    def removal_of_view(self, view: int) -> RemoveView:
        """The edit that removes a view, by its id."""
        return RemoveView(frames=tuple(range(len(self._stored))), joints=(), view=view)

    def edit_of_view(self, view: int, edit: KeypointEdit) -> EditView:
        """The edit that makes `edit` in a view, whose frames are counted from the view's first. Raises InputError if
        the view is no longer there, or lacks a frame."""
        there = next((one for one in self.views if one.id == view), None)
        if there is None:
            raise InputError("This other view is no longer there: someone has removed it.")
        check(edit, there.standing.added.count, there.standing.added.first_frame)
        frames = there.frames_beside(edit.frames, len(self._stored), self._stored.frame_rate)
        return EditView(frames=frames, joints=(), view=view, edit=edit)

    @property
    def has_detections(self) -> bool:
        """Whether anything was detected in any frame; if not, `take_detections` can be called."""
        return self._detected

    def take_detections(
        self,
        keypoints: Keypoints,
        notes: tuple[str, ...] = (),
        *,
        detector: str = "",
        silhouettes: Silhouettes | None = None,
        camera: Camera | None = None,
        before: Clip | None = None,
    ) -> None:
        """Store the detections of a project created without keypoints; they are on disk when this returns.

        Args:
            keypoints: For every frame of the clip.
            notes: For users, appended to the clip's.
            detector: Its name in `keypoint_noise.DETECTORS`; empty if unknown.
            silhouettes: For every frame, if the detector provides them.
            camera: The clip's new camera, with a focal length derived from the detections; None: unchanged.
            before: The clip before the detections that these replace; None: it has none.

        Raises:
            InputError: There are detections that must stay or that edits or runs depend on; the keypoints have the
                wrong number of frames, or none was detected; or the project cannot be written. Nothing has changed.
        """
        with self._changing_files, ExitStack() as stack:
            if self.has_detections and before is None:
                raise InputError(f"{self.folder}: already has keypoints. Make a new project for others.")
            if before is not None:
                stack.enter_context(self._replacing())
            if before is not None and (there := self._edits_and_runs()):
                raise InputError(
                    f"This person already has {there}. Make a new project for another one (--person, --out)."
                )
            if len(keypoints) != len(self._stored):
                raise InputError(
                    f"Found keypoints of {len(keypoints)} frames; expected {len(self._stored)}, the clip's."
                )
            if not (keypoints.confidence > 0).any():
                raise InputError(f"No keypoints were found in any of the {len(self._stored)} frames.")
            plain = before or self._stored
            stored = replace(
                self._stored,
                keypoints=_fixed(keypoints),
                detector=detector,
                notes=(*plain.notes, *notes),
                silhouettes=silhouettes,
                camera=camera or plain.camera,
            )
            EditHistory(stored.keypoints, self.log)  # what could not be opened again must not get onto the disk
            replace_detections(self.folder, self._database, stored)
            with self._guard:
                self._stored, self._detected, self._clip, self._footage = stored, True, None, None
                self._history = EditHistory(stored.keypoints, self._log, first_frame=stored.first_frame)
                self.keypoints_version += 1

    def set_camera(self, camera: Camera, notes: tuple[str, ...] = ()) -> None:
        """Set the clip's camera; it is on disk when this returns. Runs keep their camera.

        Args:
            camera: For the clip's images. Another lens changes the undistorted detections.
            notes: For users, replacing those about the previous camera.

        Raises:
            InputError: It is for images of another size, or has another lens while edits or runs depend on the current
                one; or the project cannot be written. Nothing has changed.
        """
        self.refuse_read_only()
        with self._changing_files, ExitStack() as stack:
            before = self._stored
            if camera.size != before.camera.size:
                raise InputError(f"The camera is for images of {camera.size}; expected {before.camera.size} pixels.")
            kept = tuple(note for note in before.notes if note not in before.camera.notes)
            camera = replace(camera, notes=notes)
            stored = replace(before, camera=camera, notes=(*kept, *notes))
            if camera.lens == before.camera.lens:
                replace_camera(self._database, camera, stored.notes)
            else:
                stack.enter_context(self._replacing())
                self._refuse_another_lens()
                filmed = filmed_keypoints(before.keypoints, before.camera.lens)
                straight, lens_notes = straightened_keypoints(filmed, camera.lens)
                stored = replace(stored, keypoints=_fixed(straight), notes=(*stored.notes, *lens_notes))
                replace_detections(self.folder, self._database, stored)
            with self._guard:
                self._stored, self._clip, self._footage = stored, None, None
                self.keypoints_version += 1  # even with the same lens: another camera projects fits elsewhere
                if stored.keypoints is not before.keypoints:
                    self._history = EditHistory(stored.keypoints, self._log, first_frame=stored.first_frame)
                    self.video_version += 1

    def set_height(self, height: float | None) -> None:
        """Set the person's height in centimetres, for future fits; it is on disk when this returns. Raises InputError
        if the project cannot be written."""
        self.refuse_read_only()
        replace_height(self._database, height)
        self.height = height

    @contextmanager
    def _replacing(self) -> Iterator[None]:
        """Refuse edits and runs within the block: they would be based on the old keypoints."""
        with self._guard:  # an edit that is being written is in the log afterwards
            self.runs.refusal = _REPLACING
        try:
            yield
        finally:
            self.runs.refusal = ""

    def _edits_and_runs(self) -> str:
        """What depends on the detections, for users; empty if nothing does."""
        edits = [entry for entry in self.log if not isinstance(entry.action, Remark)]
        runs = [*self.runs.all(), *self.runs.all(deleted=True)]
        return " and ".join(["edits"] * bool(edits) + ["runs"] * bool(runs))

    def _refuse_another_lens(self) -> None:
        if there := self._edits_and_runs():
            raise InputError(
                f"This camera's lens differs from the project's, on which {there} depend. Make "
                "a new project with it (tcfit new --camera), or leave the distortion out of the file."
            )

    def relink(self, source: Path, *, view: int | None = None) -> None:
        """Set the path of the video or the images of the clip, or of another view by its id. Raises InputError if there
        is nothing, it is neither a video nor a folder of images, or the project cannot be written."""
        self.refuse_read_only()
        with self._changing_files:
            link = media.link(source, self.folder)
            media.check_decodes(source)
            with self._database.transaction() as connection:
                if view is None:
                    connection.execute("UPDATE clip SET media = ?", (msgspec.json.encode(link).decode(),))
                else:
                    store_view_link(connection, view, link)
            found = media.find(link, self.folder)
            with self._guard:
                if view is None:
                    self.media = found
                else:
                    self._view_media[view] = found
                self.video_version += 1

    @property
    def reference(self) -> Reference | None:
        """The reference for fits, if any. Raises InputError if its file is damaged."""
        with self._guard:
            if not self._looked:
                path = self.folder / _REFERENCE
                self._reference, self._looked = read_reference(path) if path.is_file() else None, True
            return self._reference

    def set_reference(self, reference: Reference) -> None:
        """Set the reference for fits; it is on disk when this returns. Raises InputError if it has no frame in common
        with the clip, or the project cannot be written."""
        self.refuse_read_only()
        reference.frames_of(len(self._stored), self._stored.first_frame, self._stored.frame_rate)
        path = self.folder / _REFERENCE
        with self._changing_files, accessing(path), replacing(path) as draft:
            write_reference(draft, reference)
        with self._guard:
            self._reference, self._looked = reference, True

    def _marks_done(self) -> list[LogEntry]:
        with self._guard:
            return self._history.marks

    @property
    def notes(self) -> tuple[Note, ...]:
        """The notes on frames, in order of frames."""
        with self._guard:
            return self._history.notes

    @property
    def log(self) -> tuple[LogEntry, ...]:
        """All edits and remarks, oldest first."""
        with self._guard:
            return tuple(self._log)

    def last_said(self, count: int) -> list[LogEntry]:
        """The last edits and remarks of the log, newest first; including those undone."""
        with self._guard:
            said = (entry for entry in reversed(self._log) if not isinstance(entry.action, Undo | Redo))
            return list(islice(said, count))

    def frames_changed_after(self, seen: int, *, views: bool = True) -> dict[int, tuple[int, ...]]:
        """The frames whose keypoints each log entry after the entry `seen` changes: see `edit_log.frames_changed`."""
        with self._guard:
            first = bisect_right(self._log, seen, key=lambda entry: entry.id)
            return frames_changed(self._log[first:], self._history.standing.said, views=views)

    def frames_edited_since(self, seen: int) -> frozenset[int]:
        """The frames of the edits that stand now but did not after the entry `seen`, or vice versa."""
        changed = self.standing.changes(seen)
        return frozenset(frame for said in changed if not isinstance(said, Remark) for frame in said.frames)

    @property
    def standing(self) -> Standing[Said]:
        """Which edits and remarks stand, and stood after each entry of the log."""
        return self._history.standing

    @property
    def last_edit(self) -> int:
        """Id of the last log entry, 0 without any: identifies the keypoints that a run was fitted to."""
        with self._guard:
            return self._log[-1].id if self._log else 0

    @property
    def undoable(self) -> LogEntry | None:
        """The edit or remark that `undo` would revert."""
        with self._guard:
            return self._history.undoable

    @property
    def redoable(self) -> LogEntry | None:
        """The edit or remark that `redo` would restore."""
        with self._guard:
            return self._history.redoable

    def undo(self, *, author: str = "") -> LogEntry | None:
        """Undo the last edit or remark; returns it, if any. Raises InputError as `append`."""
        with self._guard:
            if edit := self._history.undoable:
                self.append(Undo(edit=edit.id), author=author)
            return edit

    def redo(self, *, author: str = "") -> LogEntry | None:
        """Redo what was undone last; returns it, or None. Raises InputError as `append`."""
        with self._guard:
            if edit := self._history.redoable:
                self.append(Redo(edit=edit.id), author=author)
            return edit

    def append(self, action: LogAction, *, author: str = "", video: MediaLink | None = None) -> LogEntry:
        """Make an edit or a mark; it is on disk when this returns. Raises InputError if it is invalid for this clip, or
        the project cannot be written; nothing has changed.

        Args:
            action: Which.
            author: Who makes it.
            video: That of a view that is added.
        """
        with self._guard:
            if self.runs.refusal and not isinstance(action, Remark | Undo | Redo):
                raise InputError(self.runs.refusal)
            text = encode(action)
            action = decode(text)  # nothing unreadable may get into the log
            self._history.check(action)
            time = datetime.now(UTC)
            with self._database.transaction() as connection:
                values = (time.isoformat(), author, text)
                added = connection.execute("INSERT INTO edits (time, author, action) VALUES (?, ?, ?)", values)
                number = added.lastrowid
                assert number is not None
                if video is not None:
                    store_view_link(connection, number, video)
            if video is not None:
                self._view_media[number] = media.find(video, self.folder)
            entry = LogEntry(id=number, time=time, author=author, action=action)
            self._history.add(entry)
            self._log.append(entry)
            said = self._history.standing.said(action.edit) if isinstance(action, Undo | Redo) else action
            if isinstance(said, Remark):
                self.marks_version += 1
            else:
                self.keypoints_version += 1
            return entry

    def close(self) -> None:
        """Let others write; this object can no longer be used."""
        with self._guard:
            self._database.close()
            if self._lock:
                self._lock.release()
                self._lock = None

    def __enter__(self) -> "Project":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()


def _fixed(keypoints: Keypoints) -> Keypoints:
    """The same as detections, in their own read-only arrays."""
    xy, confidence = (np.array(array, dtype=float) for array in (keypoints.xy, keypoints.confidence))
    for array in (xy, confidence):
        array.setflags(write=False)
    return Keypoints(xy=xy, confidence=confidence)


def _readable_log(store: Database) -> list[LogEntry]:
    """The undamaged entries, without removed kinds of edits and their undos."""
    log, removed = list[LogEntry](), set[int]()
    for row in store.rows("SELECT * FROM edits ORDER BY id"):
        if str(row["action"]).startswith(_REMOVED):
            removed.add(row["id"])
            continue
        entry = store.damage.read(row, f"edit {row['id']}", _entry)
        if entry is not None and not (isinstance(entry.action, Undo | Redo) and entry.action.edit in removed):
            log.append(entry)
    return log


def _entry(row: Columns) -> LogEntry:
    return LogEntry(
        id=row.read("id", of(Count)),
        time=row.read("time", time),
        author=row.read("author", text),
        action=row.read("action", decode),
    )
