"""Motions in and out: results of other programs, animations, rigs and meshes."""
