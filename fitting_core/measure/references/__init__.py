"""What fits are compared with: points, bodies and stored references."""
