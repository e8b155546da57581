"""The rigs that motions are put on: well-known ones, and the user's own."""
