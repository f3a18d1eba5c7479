"""Try many mutants of one kind; a line for each defect, and the counts."""

from __future__ import annotations

import json
import sys
import tempfile
import time
import traceback
from pathlib import Path

from tests.fuzzing import campaigns, data_files, results

KINDS = {"data": data_files.try_one, "campaigns": campaigns.try_one, "results": results.try_one}


def main(kind: str, count: int, first: int = 0, log: str = "") -> int:
    """Return how many mutants showed a defect."""
    counts, defects, slowest = {"refused": 0, "read": 0}, 0, 0.0
    with tempfile.TemporaryDirectory() as place:
        for seed in range(first, first + count):
            start = time.process_time()
            try:
                found = KINDS[kind](seed, Path(place, "mutant") if kind == "results" else Path(place))
            except Exception as error:
                defects += 1
                where = traceback.extract_tb(error.__traceback__)[-1]
                sys.stdout.write(
                    f"seed {seed}: {type(error).__name__}: {str(error)[:200]} ({where.filename}:{where.lineno})\n"
                )
                sys.stdout.flush()
                continue
            counts["read" if found.read else "refused"] += 1
            slowest = max(slowest, time.process_time() - start)
            if log:
                with Path(log).open("a", encoding="utf-8") as file:
                    file.write(json.dumps([seed, *found]) + "\n")
    words = ", ".join(f"{number} {name}" for name, number in counts.items())
    sys.stdout.write(
        f"{kind}: {count} mutants from seed {first}: {words}, {defects} defects; slowest {slowest:.1f} s\n"
    )
    return defects


if __name__ == "__main__":
    sys.exit(min(main(sys.argv[1], int(sys.argv[2]), *map(int, sys.argv[3:4]), *sys.argv[4:5]), 1))
