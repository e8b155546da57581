"""What options of the camera may say. Imports nothing heavy."""

from typing import Literal

FocalRule = Literal["auto", "diagonal"]
"""Default for a missing focal length: from the images' metadata or else estimated from the clip; or the image
diagonal."""
DEFAULT_RULE: FocalRule = "auto"
"""What commands and the library use where no focal length is given."""
Up = Literal["x", "y", "z", "-x", "-y", "-z"]
"""The axis of a world that points against gravity."""
