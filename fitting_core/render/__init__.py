"""Off-screen pictures of bodies: overlays on video, and sheets of poses. The only user of pyrender."""
