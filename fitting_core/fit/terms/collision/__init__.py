"""Self-collision of the body mesh: which triangles intersect, and how deep they intrude.

Find the pairs with a `CollisionFinder`, then evaluate `penetration` on them while they are held fixed.
"""

from fitting_core.fit.terms.collision.detection import (
    CollisionFinder,
    body_collision_finder,
    collision_finder,
    find_collisions,
)
from fitting_core.fit.terms.collision.distance_field import (
    SIGMA,
    VertexGradient,
    cost_and_gradient,
    pair_vertices,
    penetration,
    residuals_with_jacobian,
)
from fitting_core.fit.terms.collision.parts import body_parts, neighbouring_parts

__all__ = [
    "SIGMA",
    "CollisionFinder",
    "VertexGradient",
    "body_collision_finder",
    "body_parts",
    "collision_finder",
    "cost_and_gradient",
    "find_collisions",
    "neighbouring_parts",
    "pair_vertices",
    "penetration",
    "residuals_with_jacobian",
]
