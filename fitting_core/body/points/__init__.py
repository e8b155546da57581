"""Joints, keypoints and other points of a body, with their derivatives by the pose."""
