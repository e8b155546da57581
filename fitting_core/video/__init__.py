"""Frames of a video or of images, their names and times, people followed through them, and encoding."""
