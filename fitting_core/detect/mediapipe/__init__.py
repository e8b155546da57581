"""MediaPipe's networks: people, bodies, hands and faces, as tcfit's keypoints."""
