"""Frame numbers in file names, and the order in which people expect numbered files."""

import re

_NUMBERED = re.compile(r"^(?P<prefix>.*?)(?P<number>\d+)$", re.DOTALL)


def natural_key(name: str) -> tuple[tuple[int, str], ...]:
    """Sort key under which ``frame2`` comes before ``frame10``; upper and lower case count as the same."""
    parts = re.split(r"(\d+)", name.lower())
    return tuple((int(part), "") if k % 2 else (-1, part) for k, part in enumerate(parts))


def split_number(stem: str) -> tuple[str, int | None]:
    """What stands before the number at the end of a file's stem, and that number: ``walk_0012`` is ("walk_", 12).

    The number is None where the stem does not end in digits.
    """
    match = _NUMBERED.match(stem)
    return (match["prefix"], int(match["number"])) if match else (stem, None)


def spans(frames: list[int], most: int = 5) -> str:
    """Ascending frame numbers in words: ``3, 7-12``; after ``most`` spans, how many follow."""
    starts = [k for k, t in enumerate(frames) if k == 0 or t != frames[k - 1] + 1]
    ends = [*(k - 1 for k in starts[1:]), len(frames) - 1]
    words = [str(frames[a]) if a == b else f"{frames[a]}-{frames[b]}" for a, b in zip(starts, ends, strict=True)]
    return ", ".join(words[:most]) + (f" and {len(words) - most} more" if len(words) > most else "")
