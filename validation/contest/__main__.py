"""Run the contest and write its page: `python -m validation.contest --out reports/contest`."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from bayesdamp.types import InputError, Refusal
from validation.contest.environments import Child
from validation.contest.measured import measured_records
from validation.contest.page import write
from validation.contest.records import closed_form, simulate_record
from validation.contest.roster import ROSTER
from validation.contest.rows import COLUMNS, row_of, with_others
from validation.rows import complete_rows, read_rows, write_rows

SEED, COUNT = 811, 200
MEASURED = Path("../shared/data")
"""The folder that contains `ten_runs/`, the measured records; without it these are omitted."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return 0, or 2 after a wrong option or table."""
    parser = argparse.ArgumentParser(prog="python -m validation.contest", description=__doc__)
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument(
        "--count", type=int, default=COUNT, help="number of simulated records, of five groups in turn"
    )
    parser.add_argument("--peers", nargs="+", default=list(ROSTER), choices=list(ROSTER))
    parser.add_argument("--out", type=Path, default=Path("reports/contest"))
    parser.add_argument("--rows", type=Path, help="table of the rows; by default OUT/rows.csv")
    parser.add_argument("--kept", type=Path, help="table from which the rows of the other peers are copied")
    options = parser.parse_args(arguments)
    entries = {name: ROSTER[name] for name in options.peers}
    environments = {e.environment.name: e.environment for e in entries.values() if e.environment is not None}
    missing = {name: why for name, environment in environments.items() if (why := environment.make())}
    able = [n for n, e in entries.items() if e.environment is None or e.environment.name not in missing]
    records = []
    try:
        records += measured_records(MEASURED)
    except Refusal as refusal:
        print(f"measured records are omitted: {refusal}", file=sys.stderr)
    records += [simulate_record(options.seed, number) for number in range(options.count)]
    for name in able:
        if entries[name].environment is None:  # import and compile before any record is timed
            row_of(closed_form(), name)
    table = options.rows or options.out / "rows.csv"
    todo = {f"{record.name}/{name}": (record, name) for record in records for name in able}
    try:
        complete_rows(table, COLUMNS, todo, row_of, workers=1, key=("record", "peer"))
        rows = read_rows(table, COLUMNS)
        if options.kept:
            rows = with_others(rows, read_rows(options.kept, COLUMNS), records, options.peers)
            write_rows(options.out / "rows.csv", rows)
    except InputError as fault:
        print(fault, file=sys.stderr)
        return 2
    for name in able:
        if isinstance(peer := entries[name].peer, Child):
            peer.close()
    if rows.empty:
        print(f"{table}: there are no rows for a page", file=sys.stderr)
        return 2
    write(options.out, rows, missing)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
