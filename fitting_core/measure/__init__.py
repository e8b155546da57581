"""How far a fit is from a reference, frame by frame and in figures, and the report of it."""
