"""Read tables of many records, compute their missing rows in several processes, and write the pages on them."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import as_completed
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from bayesdamp.machine import processes
from bayesdamp.types import InputError

Work = Callable[..., Mapping[str, object]]
"""A function that computes one row of a table, as a mapping from columns to values. It must be importable by its name,
because other processes call it."""


def read_rows(table: Path, columns: Sequence[str] = ()) -> pd.DataFrame:
    """Return the rows of a CSV file, with NaN for empty fields; no rows if there is no file.

    Raises InputError if `columns` are given and the file has others.
    """
    if not table.is_file():
        return pd.DataFrame(columns=list(columns))
    rows = pd.read_csv(table, keep_default_na=False, na_values=[""])
    if columns and list(rows.columns) != list(columns):
        raise InputError(f"{table}: the columns differ from those of this table; please give another file")
    return rows


def write_rows(table: Path, rows: pd.DataFrame, append: bool = False) -> None:
    """Write rows to a CSV file, numbers with six significant digits; `append` adds them to an existing file."""
    table.parent.mkdir(parents=True, exist_ok=True)
    header = not (append and table.is_file())
    rows.to_csv(table, index=False, float_format="%.6g", mode="a" if append else "w", header=header)


def where(rows: pd.DataFrame, mask: ArrayLike = True, /, **values: object) -> pd.DataFrame:
    """Return the rows in which a mask, (n,), is true, and in which the named columns have the given values."""
    chosen = np.broadcast_to(np.asarray(mask, bool), len(rows))
    for column, value in values.items():
        chosen = chosen & (rows[column].to_numpy() == value)
    return rows.iloc[np.flatnonzero(chosen)]


def numbers(rows: pd.DataFrame, column: str) -> np.ndarray:
    """Return the values of a column of numbers in the rows that have one, (n,)."""
    values = rows[column].to_numpy(float)
    return values[np.isfinite(values)]


def total(rows: pd.DataFrame, column: str) -> int:
    """Return the sum of a column of whole numbers or booleans."""
    return int(numbers(rows, column).sum())


def complete_rows(
    table: Path,
    columns: Sequence[str],
    todo: Mapping[str, tuple[Any, ...]],
    work: Work,
    workers: int = 2,
    key: Sequence[str] = (),
) -> pd.DataFrame:
    """Compute and append the rows that a table lacks; return all requested rows in the requested order.

    Each row is saved as soon as it is computed, so that an interrupted run resumes.

    Parameters
    ----------
    table : Path
        The CSV file. It may not exist yet.
    columns : sequence of str
        The columns of the table.
    todo : mapping
        The requested rows: the name of each, and its arguments of `work`.
    work : callable
        Function that returns a row.
    workers : int
        Number of processes; 1 computes in this process.
    key : sequence of str
        The columns whose values, joined by slashes, are the name of a row; by default the first column.

    Raises
    ------
    InputError
        The table has other columns.
    """

    def by_name() -> pd.DataFrame:
        rows = read_rows(table, columns)
        parts = rows[list(key or columns[:1])].astype(str).to_numpy().tolist()
        return rows.set_index(pd.Index(["/".join(part) for part in parts], dtype=str))

    done = set(by_name().index)
    missing = [given for name, given in todo.items() if name not in done]
    with processes(workers) if min(workers, len(missing)) > 1 else nullcontext() as pool:
        results = (
            (task.result() for task in as_completed([pool.submit(work, *given) for given in missing]))
            if pool
            else (work(*given) for given in missing)
        )
        for i, row in enumerate(results, 1):
            assert row.keys() <= set(columns), (
                f"columns without a name in the table: {row.keys() - set(columns)}"
            )
            write_rows(table, pd.DataFrame([row], columns=list(columns)), append=True)
            result = row.get("named") or row.get("outcome", "")
            print(f"{i}/{len(missing)} {row[columns[0]]} {result}".rstrip(), file=sys.stderr, flush=True)
    return by_name().loc[list(todo)].reset_index(drop=True)


def page_options(description: str | None, **numbers: int) -> argparse.ArgumentParser:
    """Return the parser of a page's command line: its table of rows, its folder, the number of processes, and numbers.

    numbers: names of further options whose values are whole numbers, and their defaults.
    """
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("table", type=Path, help="CSV file of the rows; missing rows are added")
    parser.add_argument("folder", type=Path, help="folder of the page")
    for name, default in {"workers": 2, **numbers}.items():
        parser.add_argument(f"--{name}", type=int, default=default)
    return parser


def make_page(
    options: argparse.Namespace,
    shipped: str,
    columns: Sequence[str],
    todo: Mapping[str, tuple[Any, ...]],
    work: Work,
    page: Callable[[pd.DataFrame], str],
    key: Sequence[str] = (),
) -> None:
    """Compute the rows that the table lacks; write README.md and a copy of the requested rows into the folder.

    Parameters
    ----------
    options : Namespace
        The parsed options of `page_options`.
    shipped : str
        Name of the file with the rows in the folder.
    columns, todo, work, key
        As in `complete_rows`.
    page : callable
        Function that returns the page in Markdown, from the rows.
    """
    rows = complete_rows(options.table, columns, todo, work, options.workers, key)
    write_rows(options.folder / shipped, rows)
    (options.folder / "README.md").write_text(page(rows), encoding="utf-8")
