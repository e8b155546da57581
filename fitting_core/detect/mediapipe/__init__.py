"""MediaPipe's networks: how they reach a computer, and what they see in a video."""
