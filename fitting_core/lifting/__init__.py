"""From keypoints in the image to positions in space, as far as a network can infer them."""
