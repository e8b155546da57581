"""Self-collision of the body mesh: which triangles intersect, and how deep they intrude."""
