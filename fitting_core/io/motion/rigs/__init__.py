"""Files of animators' rigs: read as skeletons and mappings, written with the motion of a fit on them."""
