"""Results of learned systems: opening their files without running anything in them, and a table of their layouts."""
