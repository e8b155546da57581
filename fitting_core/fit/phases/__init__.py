"""The three phases: every frame on its own, one shape, consistency over time."""
