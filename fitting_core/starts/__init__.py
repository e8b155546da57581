"""Motions of other systems brought into a clip, to begin a fit with or to be compared."""
