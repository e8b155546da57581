"""Captured motion before many cameras, through a detector with measured errors: what work on depth is judged by."""
