"""Everybody in a clip: detected in each frame, followed, rejoined after absences, with what is uncertain."""
