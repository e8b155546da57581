"""Landmarks, contour and expressions of the free bodies."""
