"""Other views of the same person: clips by cameras that are neither synchronised nor calibrated against the first."""
