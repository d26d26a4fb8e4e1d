"""The page of the benchmarks: tables, and ratios with those of the run before."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from bayesdamp.formatting import markdown_table
from bayesdamp.store.files import write_bytes, write_json
from bayesdamp.store.results import provenance

PACKAGES = ("bayesdamp", "jax", "numpy", "scipy", "numba", "numpyro")

MEASURED: dict[str, dict[str, Any]] = {}
"""Tables of this run by title, each with its ratios and with the bars that these should reach."""


def add_table(
    title: str,
    header: Sequence[str],
    rows: Sequence[Sequence[str]],
    ratios: Mapping[str, float],
    bars: Mapping[str, float] | None = None,
) -> None:
    """Print a table and add it to the page. Of each ratio larger is better for bayesdamp."""
    MEASURED[title] = {"header": header, "rows": rows, "ratios": dict(ratios), "bars": dict(bars or {})}
    print(f"\n{title}\n{markdown_table(header, rows)}")


def write_page(measured: dict[str, Any], folder: Path) -> None:
    """Write page and data. Tables of earlier runs that this run did not measure remain."""
    folder.mkdir(parents=True, exist_ok=True)
    data = folder / "results.json"
    before = json.loads(data.read_text("utf-8")) if data.is_file() else {}
    about = provenance(packages=PACKAGES)
    write_json(data, tables := before | measured)
    write_json(folder / "machine.json", about)
    ratios = []
    for title, table in tables.items():
        for name, ratio in table["ratios"].items():
            earlier, bar = before.get(title, {"ratios": {}})["ratios"].get(name), table["bars"].get(name)
            numbers = ["" if x is None else f"{x:.3g}" for x in (ratio, bar, earlier)]
            ratios.append([name, *numbers])
    machine = ", ".join(f"{name} {value}" for name, value in about["machine"].items())
    parts = [
        f"# Benchmarks\n\n`make bench` writes this page. The last run was on one machine ({machine}; versions are in "
        "`machine.json`). Times are CPU seconds of one thread unless a table states otherwise. Both sides of a ratio "
        "were measured in turns, and the best of several measurements counts.",
        "## Ratios\n\nHow many times faster bayesdamp is, or how many times less it needs than the bar.\n\n"
        + markdown_table(["what", "ratio", "bar", "run before"], ratios),
    ]
    for title, table in tables.items():
        mark = "" if title in measured else "Measured in an earlier run.\n\n"
        parts.append(f"## {title}\n\n{mark}{markdown_table(table['header'], table['rows'])}")
    write_bytes(folder / "README.md", ("\n\n".join(parts) + "\n").encode())
