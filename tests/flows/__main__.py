"""Plays many flows: python -m tests.flows --count 1000 --seed 0."""

import argparse
import gc
import os
import sys
import time
from pathlib import Path

from fitting_core.memory import give_back
from tests.flows.flows import play, shrunk

EARLY = 20
"""Flows after which caches are filled: memory stays the same from then on."""


def _resident() -> float:
    """Memory of this process, MB; 0 if the system does not tell."""
    gc.collect()
    give_back()
    file = Path("/proc/self/statm")
    return int(file.read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6 if file.exists() else 0.0


def main() -> int:
    """Play them; 1 if any failed."""
    parser = argparse.ArgumentParser(prog="python -m tests.flows", description=__doc__)
    parser.add_argument("--count", type=int, default=1000, help="number of flows (default: 1000)")
    parser.add_argument("--seed", type=int, default=0, help="seed of the first one (default: 0)")
    parser.add_argument("--shrink", action="store_true", help="look for the shortest beginning that fails")
    options = parser.parse_args()
    failed, begun, early = [], time.monotonic(), 0.0
    for number, seed in enumerate(range(options.seed, options.seed + options.count)):
        if number <= EARLY:
            early = _resident()
        if (failure := play(seed)) is not None:
            failed.append(seed)
            print(shrunk(failure) if options.shrink else failure, flush=True)
    seconds = time.monotonic() - begun
    print(f"{_resident():.0f} MB resident, {early:.0f} MB after {min(options.count, EARLY)} flows")
    print(f"{options.count} flows in {seconds:.0f} s, {len(failed)} failed: {failed}", flush=True)
    return bool(failed)


if __name__ == "__main__":
    sys.exit(main())
