"""A body whose keypoints tell how upper arms are twisted: those of its elbows lie beside the joints."""

from dataclasses import replace

from fitting_core.body.model import BodyModel, KeypointOffset


def with_told_twist(body: BodyModel) -> BodyModel:
    """The body with elbow keypoints 23 mm beside their joints, so that a pose has one cheapest twist."""
    elbows = {
        f"{side}_elbow": KeypointOffset(
            joint=f"{side}_elbow", bone=f"{side}_shoulder", offset=(sign * 0.001, 0.023, -0.005)
        )
        for side, sign in (("left", 1.0), ("right", -1.0))
    }
    return replace(body, keypoint_offsets=body.keypoint_offsets | elbows)
