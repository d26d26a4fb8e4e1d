"""Run the contest and write its page: `python -m validation.contest --out reports/contest`."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from bayesdamp.types import InputError, Refusal
from validation.contest import rows
from validation.contest.environments import Child
from validation.contest.measured import measured_records
from validation.contest.page import write
from validation.contest.records import Record, closed_form, simulate_record
from validation.contest.roster import ROSTER
from validation.rows import rounded, write_frame, write_row

SEED, COUNT = 811, 200
MEASURED = Path("../shared/data")
"""The folder with ten_runs/."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return 0, or 2 after a wrong option or table."""
    parser = argparse.ArgumentParser(prog="python -m validation.contest", description=__doc__)
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument(
        "--count", type=int, default=COUNT, help="number of simulated records, of five groups in turn"
    )
    parser.add_argument("--peers", nargs="+", default=list(ROSTER), help=", ".join(ROSTER))
    parser.add_argument("--out", type=Path, default=Path("reports/contest"))
    parser.add_argument("--rows", type=Path, help="table of the rows; by default OUT/rows.csv")
    parser.add_argument("--kept", type=Path, help="table from which the rows of the other peers are copied")
    options = parser.parse_args(arguments)
    unknown = [name for name in options.peers if name not in ROSTER]
    if unknown or options.seed < 0 or options.count < 0:
        wrong = f"{unknown[0]!r} is not a peer" if unknown else "--seed and --count must not be negative"
        print(f"{wrong}; peers are {', '.join(ROSTER)}", file=sys.stderr)
        return 2
    missing = _missing(options.peers)
    table = options.rows or options.out / "rows.csv"
    try:
        _run(options, table, missing)
        answers = rows.read(table)
        if options.kept:
            others = rows.of_others(rows.read(options.kept), _records(options), options.peers)
            answers = rows.together(answers, others, list(ROSTER))
            write_frame(options.out / "rows.csv", answers)
    except InputError as fault:
        print(fault, file=sys.stderr)
        return 2
    if answers.empty:
        print(f"{table}: there are no rows for a page", file=sys.stderr)
        return 2
    write(options.out, answers, missing)
    return 0


def _missing(peers: Sequence[str]) -> dict[str, str]:
    """Install the environments; return those that failed, with the reason."""
    wanted = {e.name: e for e in (ROSTER[name].environment for name in peers) if e is not None}
    return {name: why for name, e in wanted.items() if (why := e.make())}


def _run(options: argparse.Namespace, table: Path, missing: dict[str, str]) -> None:
    entries = {name: ROSTER[name] for name in options.peers}
    able = {n: e for n, e in entries.items() if e.environment is None or e.environment.name not in missing}
    read = rows.read(table)
    for entry in able.values():
        if entry.environment is None:  # import and compile before any record is timed
            rows.row_of(closed_form(), "", entry.peer)
    done = set(zip(read["record"], read["peer"], strict=True))
    for record in _records(options):
        for name in (name for name in able if (record.name, name) not in done):
            write_row(table, rows.COLUMNS, rounded(rows.row_of(record, name, able[name].peer)))
    for entry in able.values():
        if isinstance(entry.peer, Child):
            entry.peer.close()


def _records(options: argparse.Namespace) -> Iterator[Record]:
    """Yield the measured records, then the simulated ones."""
    try:
        yield from measured_records(MEASURED)
    except Refusal as refusal:
        print(f"measured records are omitted: {refusal}", file=sys.stderr)
    for number in range(options.count):
        yield simulate_record(options.seed, number)


if __name__ == "__main__":
    raise SystemExit(main())
