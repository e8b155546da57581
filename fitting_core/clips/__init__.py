"""From files to clips: frames, keypoints, people and camera put together into what is fitted."""
