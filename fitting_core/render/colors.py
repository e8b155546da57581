"""The colours of pictures, videos and the app: one for each meaning, distinct with colour-deficient vision too."""

COLORS: dict[str, tuple[str, str]] = {
    # Main button, pressed, focus, progress.
    "accent": ("#6ea8fe", "#2563c9"),
    # The fit that is corrected; the fit it is compared with, and other people.
    "fit": ("#ff963c", "#b8621b"),
    "beside": ("#a88ede", "#7652b8"),
    # Groups of keypoints.
    "body": ("#3a8c88", "#16988a"),
    "left_hand": ("#58e98d", "#1e642e"),
    "right_hand": ("#e19cc5", "#962380"),
    "face": ("#f2f1ee", "#49484a"),
    # Keypoints and frames.
    "selected": ("#ffe14d", "#8a6d00"),
    # Suspicious places, flags, warnings.
    "suspicious": ("#ffb02e", "#945200"),
    # Bad keypoints, failures, deletion.
    "bad": ("#ff5a52", "#c92a2a"),
    # Checked, approved, better.
    "checked": ("#55c26a", "#1f7a34"),
    # Corrections, keyframes, notes.
    "strong": ("#ffffff", "#000000"),
}
"""sRGB on dark ground and over a video, and on light ground."""


def rgb(meaning: str, *, dark: bool = True) -> tuple[int, int, int]:
    """Red, green and blue of one of COLORS, 0 to 255, sRGB."""
    red, green, blue = bytes.fromhex(COLORS[meaning][not dark][1:])
    return red, green, blue


def linear(meaning: str) -> tuple[float, float, float]:
    """Linear red, green and blue of the colour on dark ground, 0 to 1."""
    red, green, blue = (
        c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in (v / 255 for v in rgb(meaning))
    )
    return red, green, blue
