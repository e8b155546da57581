"""What options of the camera may say. Imports nothing heavy."""

from typing import Literal

FocalRule = Literal["auto", "diagonal"]
"""What stands in for a focal length that nobody gave: what the images tell, or else an estimate from the clip; or the
image's diagonal."""
DEFAULT_RULE: FocalRule = "auto"
"""What commands and the library use where no focal length is given."""
Up = Literal["x", "y", "z", "-x", "-y", "-z"]
"""The axis of a world that points against gravity."""
