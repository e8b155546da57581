"""Files of animators' rigs: read as skeletons and mappings, written with a fit's motion."""
