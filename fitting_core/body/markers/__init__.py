"""Markers of laboratories on the surface of a body: where they sit, sets of them, and files of sets."""
