"""References of fits: points, bodies and stored files."""
