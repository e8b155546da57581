"""Rigs that everybody knows, with the bones of the person who was fitted, and their files."""
