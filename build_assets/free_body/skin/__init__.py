"""Skinning, pose correctives and keypoint vertices of the free bodies."""
