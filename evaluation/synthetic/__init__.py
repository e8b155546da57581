"""Clips with exact truth, made on the user's computer: the demo clip and the suite."""
