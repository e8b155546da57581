"""The user's own rig of an open project, shared by all browsers."""

from pathlib import Path

from fitting_core.animation.rigs.mapping import Joints
from fitting_core.errors import InputError
from tcfit_app.project.storage.rig import KeptRig, keep_joints, keep_rig, kept_rig
from tcfit_app.review.session.tasks import Task


class OwnRig:
    """The project's rig, as stored in its folder. For the drawing thread only.

    Args:
        folder: of the project.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self.reading: Task[KeptRig] | None = None
        """The task for the upload started last."""
        self.kept: KeptRig | None = None
        self.problem = ""
        """Why the stored rig cannot be read; empty if it can."""
        try:
            self.kept = kept_rig(folder)
        except InputError as error:
            self.problem = str(error)

    @property
    def busy(self) -> bool:
        """Whether another rig is being read."""
        return self.reading is not None and self.reading.state == "running"

    def refuse_busy(self) -> None:
        """Raises InputError while another rig is being read."""
        if self.busy:
            raise InputError("Another rig is still being read: wait for it.")

    def keep(self, name: str, content: bytes) -> KeptRig:
        """Store a rig in the project. Slow: for `tasks`. Arguments and errors as in `keep_rig`."""
        self.kept, self.problem = keep_rig(self._folder, name, content), ""
        return self.kept

    def map_to(self, joints: Joints) -> None:
        """Set the mapping of its joints. Raises InputError while another rig is being read, OSError."""
        self.refuse_busy()
        if self.kept is not None:
            self.kept = keep_joints(self.kept, joints)
