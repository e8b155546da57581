"""Flows: sequences of user actions with a fault in the middle, below the browser."""
