"""Hands over a clip: movements, holds, rests, and named shapes."""
