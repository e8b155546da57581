"""A motion for animators: as a skinned rig with shapes and fewer keys, and on rigs of other proportions."""
