"""From files to clips: frames, keypoints, people and camera combined into the fit's input."""
