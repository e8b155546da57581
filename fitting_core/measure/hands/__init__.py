"""What hands do along a clip: when they move and are held, and in which shape."""
