"""The evidence for a fit: detections, and what else is known."""
