"""The short name of generated clips in the cache, which changes with all that they depend on."""

import hashlib
from pathlib import Path

_ROOT = Path(__file__).resolve().parents[2]
_SOURCES = (
    "evaluation/synthetic/**/*.py",
    "fitting_core/*.py",
    "fitting_core/body/**/*.py",
    "fitting_core/config/choices.py",
    "fitting_core/files/**/*.py",
    "fitting_core/io/truth.py",
)
"""All modules that take part in generating; a test follows the imports of both generators."""


def fingerprint(*parts: str, root: Path = _ROOT) -> str:
    """Changes whenever a module that shapes generated clips does, or one of the parts.

    Args:
        parts: What else a clip depends on: its description, the body's hash.
        root: The checkout.
    """
    digest = hashlib.sha256(" ".join(parts).encode())
    for module in sorted({path for pattern in _SOURCES for path in root.glob(pattern)}):
        digest.update(module.read_bytes())
    return digest.hexdigest()[:12]
