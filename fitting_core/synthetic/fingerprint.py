"""The short name of generated clips in the cache, which changes with all that they depend on."""

import hashlib
from pathlib import Path

_PACKAGE = Path(__file__).resolve().parents[1]
_SOURCES = (
    "*.py",
    "body/**/*.py",
    "files/**/*.py",
    "io/keypoints/**/*.py",
    "io/truth.py",
    "synthetic/**/*.py",
    "video/**/*.py",
)
"""All modules that take part in generating; a test follows the imports of both generators."""


def fingerprint(*parts: str, package: Path = _PACKAGE) -> str:
    """Changes whenever a module that shapes generated clips does, or one of the parts.

    Args:
        parts: What else a clip depends on: its description, the body's hash.
        package: The folder of fitting_core.
    """
    digest = hashlib.sha256(" ".join(parts).encode())
    for module in sorted({path for pattern in _SOURCES for path in package.glob(pattern)}):
        digest.update(module.read_bytes())
    return digest.hexdigest()[:12]
