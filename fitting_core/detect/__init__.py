"""Detectors: who is in a video, and where their keypoints are.

`DETECTORS` is the table of them; each finds everybody in a clip, in the same form (`part`). `detecting` goes through a
clip, and keeps what was found.
"""
