"""Self-collision of the body mesh: which triangles intersect, how deep they intrude, and the term made of it."""
