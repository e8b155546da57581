"""The other views that stand after some edits, with their corrections."""

from collections.abc import Iterable
from dataclasses import dataclass

from tcfit_app.project.edits.corrected import Corrected
from tcfit_app.project.edits.kinds import AddView, EditView, RemoveView


@dataclass(frozen=True, kw_only=True, eq=False)
class StandingView:
    """A view that was added and not removed."""

    id: int
    """Of the log entry that added it."""
    added: AddView
    edits: tuple[EditView, ...]
    """Its corrections, in order."""
    corrected: Corrected
    """Its keypoints with them."""


def standing_views(
    edits: Iterable[tuple[int, AddView | RemoveView | EditView]], known: Iterable[StandingView]
) -> tuple[StandingView, ...]:
    """The views in the order in which they were added.

    Args:
        edits: All that stand, with their ids in the log.
        known: An earlier result: views that have not changed are the same objects.
    """
    added, corrections = dict[int, AddView](), dict[int, list[EditView]]()
    for number, edit in edits:
        if isinstance(edit, AddView):
            added[number], corrections[number] = edit, []
        elif isinstance(edit, RemoveView):
            del added[edit.view]
        else:
            corrections[edit.view].append(edit)
    before = {view.id: view for view in known}
    return tuple(_view(number, edit, tuple(corrections[number]), before.get(number)) for number, edit in added.items())


def _view(number: int, added: AddView, edits: tuple[EditView, ...], known: StandingView | None) -> StandingView:
    if known is not None and known.added is added and known.edits == edits:
        return known
    detected = Corrected.none(added.keypoints)
    now = Corrected.none(added.keypoints)
    for one in edits:
        now.put(one.edit.frames, one.edit.joints, one.edit.values(now, detected))
    return StandingView(id=number, added=added, edits=edits, corrected=now.view)
