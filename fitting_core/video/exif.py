"""The focal length that a camera wrote into its photographs."""

import warnings
from pathlib import Path

from PIL import ExifTags, Image, UnidentifiedImageError

from fitting_core.files.regular import regular_file


def focal_35mm(path: Path) -> float | None:
    """The 35 mm equivalent in millimetres stated in a photograph; None without one, or if it is not a JPEG file."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of damaged Exif data, which tell nothing
        try:
            with Image.open(regular_file(path, most=None), formats=("JPEG",)) as photograph:
                exif = photograph.getexif().get_ifd(ExifTags.IFD.Exif)
        except (UnidentifiedImageError, SyntaxError, ValueError):
            return None
    told = exif.get(ExifTags.Base.FocalLengthIn35mmFilm)
    return float(told) if isinstance(told, int) and told > 0 else None  # 0 stands for "unknown"
