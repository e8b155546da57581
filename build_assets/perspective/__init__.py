"""Trains the network that tells how near a camera stood."""
