"""The 2D and 3D scenes."""
