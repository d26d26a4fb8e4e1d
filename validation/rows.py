"""Read tables of many records, and compute their missing rows in several processes."""

from __future__ import annotations

import argparse
import csv
import math
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import as_completed
from pathlib import Path
from typing import Any

import pandas as pd

from bayesdamp.machine import processes
from bayesdamp.store import write_table
from bayesdamp.types import InputError


def read_rows(table: Path) -> list[dict[str, str]]:
    """Return the rows of a CSV file as strings; an empty list if there is no file."""
    if not table.is_file():
        return []
    with table.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def read_frame(table: Path, columns: Sequence[str]) -> pd.DataFrame:
    """Return the rows of a CSV file as values; an empty table if there is no file.

    Raises InputError if the file has other columns.
    """
    if not table.is_file():
        return pd.DataFrame(columns=list(columns))
    frame = pd.read_csv(table, keep_default_na=False, na_values=[""])
    _require(table, list(frame.columns), columns)
    return frame


def write_frame(table: Path, rows: pd.DataFrame) -> None:
    """Write a table with six significant digits; an existing file is replaced."""
    table.parent.mkdir(parents=True, exist_ok=True)
    rows.to_csv(table, index=False, float_format="%.6g")


def complete_rows(
    table: Path,
    columns: Sequence[str],
    todo: Mapping[str, tuple[Any, ...]],
    work: Callable[..., Mapping[str, object]],
    workers: int = 2,
    key: Sequence[str] = (),
) -> list[dict[str, str]]:
    """Compute and append the rows that a table lacks; return all requested rows in the requested order.

    Parameters
    ----------
    table : Path
        The CSV file. It may not exist yet.
    columns : sequence of str
        The columns of the table.
    todo : mapping
        The requested rows: the name of each, and its arguments of `work`.
    work : callable
        Function that returns a row. It must be importable, because other processes call it.
    workers : int
        Number of processes.
    key : sequence of str
        The columns whose values, joined by slashes, are the name of a row; by default the first column.

    Returns
    -------
    list of dict
        The rows as strings.

    Raises
    ------
    InputError
        The table has other columns.
    """

    def name_of(row: Mapping[str, object]) -> str:
        return "/".join(str(row[c]) for c in key or columns[:1])

    before = read_rows(table)
    if before:
        _require(table, list(before[0]), columns)
    done = {name_of(row) for row in before}
    missing = [name for name in todo if name not in done]
    for i, row in enumerate(_computed([todo[name] for name in missing], work, workers), 1):
        write_row(table, columns, row)
        result = row.get("named") or row.get("outcome", "")
        print(f"{i}/{len(missing)} {row[columns[0]]} {result}".rstrip(), file=sys.stderr, flush=True)
    by_name = {name_of(row): row for row in read_rows(table)}
    return [by_name[name] for name in todo]


def write_row(table: Path, columns: Sequence[str], row: Mapping[str, object]) -> None:
    """Append a row; a new file first gets a header."""
    table.parent.mkdir(parents=True, exist_ok=True)
    fresh = not table.is_file()
    with table.open("a", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, columns, restval="")
        if fresh:
            writer.writeheader()
        writer.writerow(row)


def rounded(row: Mapping[str, object]) -> dict[str, object]:
    """Return a row with its numbers as strings of six significant digits; NaN becomes an empty string."""
    return {
        name: ("" if math.isnan(value) else f"{value:.6g}") if isinstance(value, float) else value
        for name, value in row.items()
    }


def page_options(description: str | None) -> argparse.ArgumentParser:
    """Return the command line of a page: its table of rows, its folder, and the number of processes."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("table", type=Path, help="CSV file of the rows; missing rows are added")
    parser.add_argument("folder", type=Path, help="folder of the page")
    parser.add_argument("--workers", type=int, default=2)
    return parser


def make_page(
    options: argparse.Namespace,
    shipped: str,
    columns: Sequence[str],
    todo: Mapping[str, tuple[Any, ...]],
    work: Callable[..., Mapping[str, object]],
    page: Callable[[list[dict[str, str]]], str],
) -> None:
    """Compute the rows that the table lacks; write README.md and a copy of the requested rows into the folder.

    Parameters
    ----------
    options : Namespace
        The parsed options of `page_options`.
    shipped : str
        Name of the file with the rows in the folder.
    columns, todo, work
        As in `gathered`.
    page : callable
        Function that returns the page in Markdown, from the rows.
    """
    rows = complete_rows(options.table, columns, todo, work, options.workers)
    options.folder.mkdir(parents=True, exist_ok=True)
    write_table(options.folder / shipped, columns, rows)
    (options.folder / "README.md").write_text(page(rows), encoding="utf-8")


def _require(table: Path, present: Sequence[str], columns: Sequence[str]) -> None:
    """Raise InputError if the columns of a file differ from the required ones."""
    if list(present) != list(columns):
        raise InputError(f"{table}: the columns differ from those of this table; please give another file")


def _computed(
    todo: Sequence[tuple[Any, ...]], work: Callable[..., Mapping[str, object]], workers: int
) -> Iterator[Mapping[str, object]]:
    """Yield the rows in the order in which the processes finish them."""
    if min(workers, len(todo)) <= 1:
        yield from (work(*given) for given in todo)
        return
    with processes(workers) as pool:
        for done in as_completed([pool.submit(work, *given) for given in todo]):
            yield done.result()
