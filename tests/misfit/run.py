"""Score simulated cases: `python -m tests.misfit.run TABLE --seed 1 --first 0 --count 2 [--kinds clean,beats]`."""

from __future__ import annotations

import argparse
from pathlib import Path

from bayesdamp.pipeline.workers import cache_compilations
from tests.misfit.cases import INSIDE, OUTSIDE, drawn
from tests.misfit.scoring import scored

LAWS = ("linear",)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("table", type=Path)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--count", type=int, default=1)
    parser.add_argument("--kinds", default=",".join((*INSIDE, *OUTSIDE)))
    parser.add_argument(
        "--laws", default=",".join(LAWS), help="restoring laws of the candidates; the truth is linear"
    )
    parser.add_argument("--keep", type=Path, help="a folder for the runs themselves")
    given = parser.parse_args()
    cache_compilations()
    numbers = range(given.first, given.first + given.count)
    cases = (drawn(kind, number, given.seed) for number in numbers for kind in given.kinds.split(","))
    for row in scored(cases, given.laws.split(","), given.table, given.keep):
        print(
            row["case"],
            row.get("seconds", ""),
            row["warned"],
            row.get("wrong", ""),
            row["sentence"],
            flush=True,
        )


if __name__ == "__main__":
    main()
