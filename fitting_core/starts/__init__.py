"""Other systems' motions brought into a clip, to start a fit with or to compare."""
