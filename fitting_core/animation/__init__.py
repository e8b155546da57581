"""A motion for animators: as a skinned rig with morph targets and fewer keys, and on rigs of other proportions."""
