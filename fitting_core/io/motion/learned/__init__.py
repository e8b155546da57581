"""Results of learned systems: their files opened without running anything in them, and a table of their layouts."""
