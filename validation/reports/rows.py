"""Rows of a table of many records, computed on several processes, each kept as it is done."""

from __future__ import annotations

import csv
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import as_completed
from pathlib import Path
from typing import Any

from bayesdamp.machine.processes import processes
from bayesdamp.store import write_table
from bayesdamp.types import InputError


def read_rows(table: Path) -> list[dict[str, str]]:
    """The rows of a CSV, none where there is no file."""
    if not table.is_file():
        return []
    with table.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def gathered(
    table: Path,
    columns: Sequence[str],
    todo: Mapping[str, tuple[Any, ...]],
    work: Callable[..., Mapping[str, object]],
    workers: int = 2,
) -> list[dict[str, str]]:
    """The rows of what was asked for, in that order; those that the table lacks are computed and appended.

    todo: from a row's name, its first column, to the arguments of `work`, which must be importable. Raises InputError
    where the table has other columns.
    """
    before = read_rows(table)
    if before and list(before[0]) != list(columns):
        raise InputError(f"{table}: its columns are {', '.join(before[0])}; give another file")
    done = {row[columns[0]] for row in before}
    missing = [name for name in todo if name not in done]
    for i, row in enumerate(_computed([todo[name] for name in missing], work, workers), 1):
        write_row(table, columns, row)
        print(f"{i}/{len(missing)} {row[columns[0]]}", file=sys.stderr, flush=True)
    found = {row[columns[0]]: row for row in read_rows(table)}
    return [found[name] for name in todo]


def write_row(table: Path, columns: Sequence[str], row: Mapping[str, object]) -> None:
    """Append a row, behind a header where the file is new."""
    fresh = not table.is_file()
    with table.open("a", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, columns, restval="")
        if fresh:
            writer.writeheader()
        writer.writerow(row)


def shipped(table: Path, columns: Sequence[str], rows: Sequence[Mapping[str, str]]) -> None:
    """Write rows as a report keeps them."""
    table.parent.mkdir(parents=True, exist_ok=True)
    write_table(table, columns, rows)


def _computed(
    todo: Sequence[tuple[Any, ...]], work: Callable[..., Mapping[str, object]], workers: int
) -> Iterator[Mapping[str, object]]:
    if min(workers, len(todo)) <= 1:
        yield from (work(*given) for given in todo)
        return
    with processes(workers) as pool:
        for done in as_completed([pool.submit(work, *given) for given in todo]):
            yield done.result()
