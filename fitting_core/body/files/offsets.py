"""Where a detector's keypoints lie on a body: offsets from its joints, one table for each topology."""

from fitting_core.body.model import KeypointOffset

_BONE = {"shoulder": "collar", "elbow": "shoulder", "wrist": "elbow", "knee": "hip", "ankle": "knee"}


def _mirrored(left: dict[str, tuple[float, float, float]]) -> dict[str, KeypointOffset]:
    """Both sides, from the left one's offsets in metres."""
    table = {}
    for part, (x, y, z) in left.items():
        for side, sign in (("left", 1.0), ("right", -1.0)):
            bone = f"{side}_{_BONE[part]}"
            table[f"{side}_{part}"] = KeypointOffset(joint=f"{side}_{part}", bone=bone, offset=(sign * x, y, z))
    return table


OFFSETS: dict[int, dict[str, KeypointOffset]] = {
    # The free body against OpenPose: fitted in 3D to keypoints triangulated from four cameras (one man, 25 frames), all
    # offsets held by a prior of 20 mm; mean error 14.4 -> 12.4 mm. Its hips need none (under 4 mm).
    13492: _mirrored(
        {
            "shoulder": (-0.010, 0.005, -0.003),
            "elbow": (0.001, 0.023, -0.005),
            "wrist": (0.017, 0.0, 0.0),
            "knee": (-0.001, -0.013, -0.005),
            "ankle": (0.0, 0.014, 0.0),
        }
    ),
}
"""By number of vertices. SMPL-X's own is empty: its joints were regressed to be used with OpenPose as they are."""
