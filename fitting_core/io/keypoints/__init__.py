"""Keypoint files in and out, one file for each format, and from all people seen to one person."""
