"""A project on the disk: a clip, all corrections of its keypoints, all fits, and what a reviewer said.

A project is a folder:

| file | |
|---|---|
| project.sqlite | clip, log of edits, marks and notes, runs and settings (`storage/database.py` has the tables) |
| detections.npz | the detected keypoints, xy (T, 137, 2) in pixels, confidence (T, 137), and by what detector; stay \
once there are any |
| runs/000001.npz | what a run found (`storage/run_files.py` has the keys) |
| runs/000002/000001.npz | what a correction has replaced in a run, for undo (`storage/changes.py`); not in a packed \
project, where the fit follows an undo as any other edit |
| reference.npz | what fits are compared with, where something is known |
| handshapes.toml | the user's own set of handshapes, where there is one |
| rig/ | the user's own rig and its mapping file, where there is one; not in a packed project |
| media/ | the video or images, if they were copied; else the database knows where they are |
| project.lock | held by the one process that writes |

What a method that changes something has returned from is on the disk. A process that dies leaves a project that opens
as if it had been closed after the last such return.
"""

import threading
from bisect import bisect_right
from dataclasses import replace
from datetime import UTC, datetime
from itertools import islice
from pathlib import Path
from types import TracebackType

import msgspec
import numpy as np
from jaxtyping import Bool

from fitting_core.camera import Camera
from fitting_core.clip import Clip
from fitting_core.errors import InputError, some_of
from fitting_core.files.atomic import drafting, put_folder, sweep, sweep_beside
from fitting_core.io.people_file import holds_people, refuse_several
from fitting_core.keypoints import Keypoints
from fitting_core.lens import filmed_keypoints, straightened_keypoints
from fitting_core.measure.references.reference import Reference
from fitting_core.silhouettes import Silhouettes
from tcfit_app.project.edits.corrected import Corrected
from tcfit_app.project.edits.edit_log import (
    Action,
    EditHistory,
    LogEntry,
    Marking,
    Note,
    Redo,
    Remark,
    Undo,
    decode,
    encode,
    frames_of,
)
from tcfit_app.project.storage import database, media
from tcfit_app.project.storage.accessing import accessing
from tcfit_app.project.storage.clip import (
    read_clip,
    read_height,
    replace_camera,
    replace_detections,
    replace_height,
    write_clip,
)
from tcfit_app.project.storage.clip_review import ReviewOfClip
from tcfit_app.project.storage.columns import UNKNOWN_TIME, Columns, Count, of, text, time
from tcfit_app.project.storage.database import Database
from tcfit_app.project.storage.lock import Lock
from tcfit_app.project.storage.marks import Marks
from tcfit_app.project.storage.media import Media
from tcfit_app.project.storage.reference import store_reference, stored_reference
from tcfit_app.project.storage.runs import Runs

_LEFT_OUT = "it is left out"


class Project:
    """An open project; a context manager. Thread-safe."""

    def __init__(self, folder: Path, store: Database, held: Lock | None) -> None:
        """Use `create` or `open`."""
        self.folder = folder
        stored, link = read_clip(folder, store)
        self.media: Media = media.find(link, folder)
        """Where the video or images were when the project was opened, and what is wrong with them."""
        self.runs = Runs(folder, store, len(stored))
        self.marks = Marks(
            store, len(stored), self._marks_done, lambda action, author: self.append(action, author=author)
        )
        self._stored, self._database, self._lock = stored, store, held
        self.review = ReviewOfClip(store, lambda: self.last_edit)
        """Of the clip as a whole: see `ClipReview`."""
        self.keypoints_version = self.marks_version = self.reference_version = self.video_version = 0
        """Another number whenever the keypoints, marks and notes, what fits are compared with, or the frames of the
        video are others."""
        self.height = read_height(store)
        """Of the person, without shoes, in centimetres; None: not known. See `set_height`."""
        self._clip: Clip | None = None
        self._footage: Clip | None = None
        self._detected = bool((stored.keypoints.confidence > 0).any())
        self._guard = threading.RLock()
        """Of what is known of the project; held for moments only, for the thread that draws asks for it."""
        self._changing_files = threading.Lock()
        """Of what takes longer: other detections, another video, another reference."""
        self._reference: Reference | None = None
        self._looked = False
        if held:
            with accessing(folder):
                sweep(folder)
                sweep_beside(folder)
            self.runs.recover()
        senseless: set[int] = set()

        def leave_out(entry: LogEntry, why: InputError) -> None:
            store.damage.note(f"edit {entry.id} makes no sense ({why})", _LEFT_OUT)
            senseless.add(entry.id)

        log = _readable_log(store)
        self._history = EditHistory(stored.keypoints, log, first_frame=stored.first_frame, leave_out=leave_out)
        self._log = [entry for entry in log if entry.id not in senseless]

    @property
    def damage(self) -> tuple[str, ...]:
        """What is damaged in the database, and what stands in for it; more may be found when more is read."""
        return self._database.damage.found

    @staticmethod
    def create(folder: Path, clip: Clip, *, copy_media: bool = False) -> "Project":
        """Make a project and open it.

        Args:
            folder: Does not exist yet, or is empty.
            clip: Its keypoints become the detections, its source the project's media.
            copy_media: Copy the source into the project; else it is linked.

        Raises:
            InputError: The folder holds something, or cannot be written; the source cannot be read.
        """
        folder = folder.resolve()
        with accessing(folder):
            check_free(folder)
            folder.parent.mkdir(parents=True, exist_ok=True)
            with drafting(folder) as draft:
                draft.mkdir()
                link = None
                if clip.source:
                    link = media.copy(clip.source, draft) if copy_media else media.link(clip.source, folder)
                write_clip(draft, clip, link=link)
                check_free(folder)
                if folder.exists():
                    folder.rmdir()
                put_folder(draft, folder)
        return Project.open(folder)

    @staticmethod
    def open(folder: Path, *, read_only: bool = False) -> "Project":
        """Open a project. There is one writer at a time, and any number of readers.

        A reader sees edits and remarks as they were when it opened, runs as they are.

        Raises:
            ProjectLocked: Another one is writing; read-only it can be opened.
            InputError: It is no project, is damaged, comes from a newer tcfit, or cannot be written.
        """
        with accessing(folder):
            if not (folder / database.NAME).is_file():
                refuse_several(folder)
                raise InputError(f"{folder}: is no project of tcfit: it has no {database.NAME}. `tcfit new` makes one.")
            held = None if read_only else Lock(folder)
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

    @property
    def detections(self) -> Keypoints:
        """What was detected, in arrays that cannot be written."""
        return self._stored.keypoints

    @property
    def detected(self) -> Corrected:
        """What is corrected: the detections, and what was taken over from another person or detected again. As
        `corrected`, it shows what later edits make of it."""
        with self._guard:
            return self._history.detected

    @property
    def exchanges(self) -> list[LogEntry]:
        """What is taken over from others of the clip's people, oldest first."""
        with self._guard:
            return self._history.exchanges

    @property
    def corrected(self) -> Corrected:
        """The keypoints as they stand, with marks of what was edited and what is bad; for the thread that edits, for it
        shows what later edits make of them."""
        with self._guard:
            return self._history.corrected

    def marked(self, marking: Marking) -> list[int]:
        """The frames with any keypoint of which that is so, in order."""
        with self._guard:
            return self._history.marked(marking)

    @property
    def bad(self) -> Bool[np.ndarray, "T 137"]:
        """Which keypoints are marked as bad."""
        bad = np.zeros(self._stored.keypoints.confidence.shape, bool)
        with self._guard:
            frames = self._history.marked("bad")
            bad[frames] = self._history.corrected.bad[frames]
        return bad

    @property
    def footage(self) -> Clip:
        """The clip as it was filmed and detected, and the source where it is now: for whoever needs no corrected
        keypoints, which take longer after an edit."""
        with self._guard:
            if self._footage is None or self._footage.source != self.media.path:
                self._footage = replace(self._stored, source=self.media.path)
            return self._footage

    @property
    def clip(self) -> Clip:
        """What is to be fitted now: corrected keypoints, and the source where it is now. In a long clip it takes some
        milliseconds after an edit, for which nobody else waits."""
        while True:
            with self._guard:
                history, news = self._history, self._history.news()
            made = news.keypoints()
            with self._guard:
                if history is not self._history:
                    continue
                keypoints = history.keep(news, made)
                if self._clip is None or self._clip.keypoints is not keypoints or self._clip.source != self.media.path:
                    self._clip = replace(self.footage, keypoints=keypoints)
                return self._clip

    @property
    def has_detections(self) -> bool:
        """Whether anything was detected in any frame; without that, `take_detections` can be called."""
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
        """Give a project that was made without keypoints its detections; when this returns, they are on the disk.

        Args:
            keypoints: Of every frame of the clip.
            notes: For the user, added to those of the clip.
            detector: Who found them, by its name in `keypoint_noise.DETECTORS`; empty where nobody knows.
            silhouettes: Of every frame, where they were found as well.
            camera: The clip's from now on, with a focal length that they tell; None: it stays.
            before: The clip as it was before it got the detections whose place these take; None: it has none.

        Raises:
            InputError: It has detections that stay, or on which edits or runs stand; the keypoints are of another
                number of frames or none; or the project cannot be written. Nothing has changed.
        """
        with self._changing_files:
            if self.has_detections and before is None:
                raise InputError(f"{self.folder}: has its keypoints already. Make a new project for others.")
            if before is not None and (there := self._edits_and_runs()):
                raise InputError(
                    f"There are {there} of this person already. Make a new project for another one (--person, --out)."
                )
            if len(keypoints) != len(self._stored):
                raise InputError(
                    f"Found keypoints of {len(keypoints)} frames; expected {len(self._stored)}, the clip's."
                )
            if not (keypoints.confidence > 0).any():
                raise InputError(f"No keypoint was found in any of the {len(self._stored)} frames.")
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
        """Say what the clip was filmed with; when this returns, it is on the disk. Runs keep the camera that they have.

        Args:
            camera: Of the clip's images. With another lens, detections are straightened by that.
            notes: For the user, in place of those on the camera before.

        Raises:
            InputError: It is of images of another size, or has another lens while there are edits or runs, which stand
                where the lens before has put them; or the project cannot be written. Nothing has changed.
        """
        self.refuse_read_only()
        with self._changing_files:
            before = self._stored
            if camera.size != before.camera.size:
                raise InputError(f"The camera is of images of {camera.size}; expected {before.camera.size} pixels.")
            kept = tuple(note for note in before.notes if note not in before.camera.notes)
            camera = replace(camera, notes=notes)
            stored = replace(before, camera=camera, notes=(*kept, *notes))
            if camera.lens == before.camera.lens:
                replace_camera(self._database, camera, stored.notes)
            else:
                self._refuse_another_lens()
                filmed = filmed_keypoints(before.keypoints, before.camera.lens)
                straight, lens_notes = straightened_keypoints(filmed, camera.lens)
                stored = replace(stored, keypoints=_fixed(straight), notes=(*stored.notes, *lens_notes))
                replace_detections(self.folder, self._database, stored)
            with self._guard:
                self._stored, self._clip, self._footage = stored, None, None
                self.keypoints_version += 1  # also of the same lens: another camera sees fits elsewhere
                if stored.keypoints is not before.keypoints:
                    self._history = EditHistory(stored.keypoints, self._log, first_frame=stored.first_frame)
                    self.video_version += 1

    def set_height(self, height: float | None) -> None:
        """Say how tall the person is, in centimetres, for fits from now on; when this returns, it is on the disk.

        Raises:
            InputError: The project cannot be written.
        """
        self.refuse_read_only()
        replace_height(self._database, height)
        self.height = height

    def _edits_and_runs(self) -> str:
        """What stands on the keypoints as they were detected, for the user; empty if there is nothing."""
        edits = [entry for entry in self.log if not isinstance(entry.action, Remark)]
        runs = [*self.runs.all(), *self.runs.all(deleted=True)]
        return " and ".join(["edits"] * bool(edits) + ["runs"] * bool(runs))

    def _refuse_another_lens(self) -> None:
        if there := self._edits_and_runs():
            raise InputError(
                f"This camera has another lens than the project's, and {there} stand where that one has put them. Make "
                "a new project with it (tcfit new --camera), or leave the distortion out of the file."
            )

    def relink(self, source: Path) -> None:
        """Say where the video or the images are now.

        Raises:
            InputError: There is nothing, it is no video and no folder of images, or the project cannot be written.
        """
        self.refuse_read_only()
        with self._changing_files:
            link = media.link(source, self.folder)
            media.check_decodes(source)
            with self._database.transaction() as connection:
                connection.execute("UPDATE clip SET media = ?", (msgspec.json.encode(link).decode(),))
            found = media.find(link, self.folder)
            with self._guard:
                self.media = found
                self.video_version += 1

    @property
    def reference(self) -> Reference | None:
        """What fits are compared with, None if nothing is known. Raises InputError if its file is damaged."""
        with self._guard:
            if not self._looked:
                self._reference, self._looked = stored_reference(self.folder), True
            return self._reference

    def set_reference(self, reference: Reference | None) -> None:
        """Keep what fits are compared with from now on; when this returns, it is on the disk.

        Raises:
            InputError: It has no frame in common with the clip, or the project cannot be written.
        """
        self.refuse_read_only()
        if reference is not None:
            reference.frames_of(len(self._stored), self._stored.first_frame, self._stored.frame_rate)
        with self._changing_files:
            store_reference(self.folder, reference)
            with self._guard:
                self._reference, self._looked = reference, True
                self.reference_version += 1

    def _marks_done(self) -> list[LogEntry]:
        with self._guard:
            return self._history.marks

    @property
    def notes(self) -> tuple[Note, ...]:
        """What was written about frames, by their order."""
        with self._guard:
            return self._history.notes

    @property
    def log(self) -> tuple[LogEntry, ...]:
        """Everything that was done to the keypoints and said about frames, oldest first."""
        with self._guard:
            return tuple(self._log)

    def last_said(self, count: int) -> list[LogEntry]:
        """The last edits and remarks of the log, newest first; those that were undone as well."""
        with self._guard:
            said = (entry for entry in reversed(self._log) if not isinstance(entry.action, Undo | Redo))
            return list(islice(said, count))

    def frames_changed_after(self, seen: int) -> dict[int, tuple[int, ...]]:
        """The frames whose keypoints each entry of the log after the entry `seen` changes, as `edit_log.frames_of`."""
        with self._guard:
            first = bisect_right(self._log, seen, key=lambda entry: entry.id)
            return frames_of(self._log[first:], self._history.standing.said)

    def edits_since(self, seen: int) -> int:
        """How many edits stand now and did not after the entry `seen`, or did and do not now."""
        with self._guard:
            return self._history.standing.differing(seen)

    def frames_edited_since(self, seen: int) -> frozenset[int]:
        """The frames of the edits that `edits_since` counts."""
        with self._guard:
            changed = list(self._history.standing.changes(seen))
        return frozenset(frame for said in changed if not isinstance(said, Remark) for frame in said.frames)

    def stands(self, number: int) -> bool:
        """Whether the edit or remark of this id is done, and not undone."""
        with self._guard:
            return self._history.standing.stood(number)

    def stood(self, number: int, seen: int) -> bool:
        """Whether it was so after the entry `seen`."""
        with self._guard:
            return self._history.standing.stood(number, seen)

    def stood_by(self, seen: int, later: int | None = None) -> bool:
        """Whether all that stood after the entry `seen` stood after a later one as well; None: stands now."""
        with self._guard:
            return self._history.standing.stood_by(seen, later)

    def frames_of(self, edit: int) -> tuple[int, ...]:
        """The frames that the edit of this id changes."""
        with self._guard:
            return self._history.standing.said(edit).frames

    @property
    def last_edit(self) -> int:
        """Id of the last entry of the log, 0 without any: which state of the keypoints a run has seen."""
        with self._guard:
            return self._log[-1].id if self._log else 0

    @property
    def undoable(self) -> LogEntry | None:
        """The edit or remark that `undo` would take back."""
        with self._guard:
            return self._history.undoable

    @property
    def redoable(self) -> LogEntry | None:
        """The edit or remark that `redo` would bring back."""
        with self._guard:
            return self._history.redoable

    def undo(self, *, author: str = "") -> LogEntry | None:
        """Take the last edit or remark back; returns it, or None if there is none. Raises InputError as `append`."""
        with self._guard:
            if edit := self._history.undoable:
                self.append(Undo(edit=edit.id), author=author)
            return edit

    def redo(self, *, author: str = "") -> LogEntry | None:
        """Bring back what was undone last; returns it, or None. Raises InputError as `append`."""
        with self._guard:
            if edit := self._history.redoable:
                self.append(Redo(edit=edit.id), author=author)
            return edit

    def append(self, action: Action, *, author: str = "") -> LogEntry:
        """Make an edit or a mark; when this returns, it is on the disk.

        Raises:
            InputError: It makes no sense for this clip, or the project cannot be written; nothing has changed.
        """
        with self._guard:
            text = encode(action)
            action = decode(text)  # What could not be read back must not get into the log.
            self._history.check(action)
            time = datetime.now(UTC)
            with self._database.transaction() as connection:
                values = (time.isoformat(), author, text)
                added = connection.execute("INSERT INTO edits (time, author, action) VALUES (?, ?, ?)", values)
            number = added.lastrowid
            assert number is not None
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
        """Let others write; this object is of no use any more."""
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
    """The same as detections, in arrays of their own which nobody can write to."""
    xy, confidence = (np.array(array, dtype=float) for array in (keypoints.xy, keypoints.confidence))
    for array in (xy, confidence):
        array.setflags(write=False)
    return Keypoints(xy=xy, confidence=confidence)


def check_free(folder: Path) -> None:
    """Raises InputError if no project can be made in a folder, which may not exist."""
    if (folder / database.NAME).exists():
        raise InputError(f"{folder}: is a project already. Open it, or choose another folder.")
    if holds_people(folder):
        raise InputError(f"{folder}: is a folder of several people already. Open it, or choose another one.")
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: is a file; expected a folder, which may not exist yet.")
    if names := sorted(entry.name for entry in folder.iterdir()) if folder.exists() else []:
        raise InputError(
            f"{folder}: holds other files ({some_of(names, most=4)}). Choose a folder that is empty or new."
        )


def _readable_log(store: Database) -> list[LogEntry]:
    log: list[LogEntry] = []
    for row in store.rows("SELECT * FROM edits ORDER BY id"):
        columns = Columns(row, f"edit {row['id']}", store.damage)
        number = columns.read("id", of(Count), None, _LEFT_OUT)
        action = columns.read("action", decode, None, _LEFT_OUT)
        if number is None or action is None:
            continue
        made = columns.read("time", time, UNKNOWN_TIME, "it counts as made long ago")
        author = columns.read("author", text, "", "nobody is named")
        log.append(LogEntry(id=number, time=made, author=author, action=action))
    return log
