"""Plays many flows: python -m tests.flows --count 1000 --seed 0."""

import argparse
import sys
import time

from tests.flows.flows import play, shrunk


def main() -> int:
    """Play them; 1 if any failed."""
    parser = argparse.ArgumentParser(prog="python -m tests.flows", description=__doc__)
    parser.add_argument("--count", type=int, default=1000, help="number of flows (default: 1000)")
    parser.add_argument("--seed", type=int, default=0, help="seed of the first one (default: 0)")
    parser.add_argument("--shrink", action="store_true", help="look for the shortest beginning that fails")
    options = parser.parse_args()
    failed, begun = [], time.monotonic()
    for seed in range(options.seed, options.seed + options.count):
        if (failure := play(seed)) is not None:
            failed.append(seed)
            print(shrunk(failure) if options.shrink else failure, flush=True)
    seconds = time.monotonic() - begun
    print(f"{options.count} flows in {seconds:.0f} s, {len(failed)} failed: {failed}", flush=True)
    return bool(failed)


if __name__ == "__main__":
    sys.exit(main())
