"""The rigs that motions are put on: those that everybody knows, and the user's own."""
