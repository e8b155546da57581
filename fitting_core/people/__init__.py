"""Everybody in a clip: seen in each frame, followed, joined again after absences, and what of it is not sure."""
