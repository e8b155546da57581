"""A motion for animators: as a skinned rig with morph targets and on well-known rigs."""
