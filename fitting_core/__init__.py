"""Temporally consistent SMPL-X fits from 2D keypoints: the library behind tcfit. It knows nothing of any viewer."""
