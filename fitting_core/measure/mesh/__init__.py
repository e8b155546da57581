"""Distances between meshes, and volumes."""
