"""From keypoints in the image to where they are in space, as far as motion knows it: a network, and its use."""
