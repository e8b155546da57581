"""The scripts that are played: waving, sitting down cross-legged, signing, the demo clip."""
