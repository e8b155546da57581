"""What speaks for a fit: detections, and what is known besides."""
