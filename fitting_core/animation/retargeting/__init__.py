"""From the fit's skeleton to a rig: rotations between rest poses, standing feet, touching hands."""
