"""What the benchmarks measured, as a page: tables, ratios beside those of the run before, the machine."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from bayesdamp.store import provenance, read_table, write_bytes, write_json, write_table

LOSS = 0.2
"""Share of a ratio that must be lost for it to be shown as one."""
COLUMNS = ("name", "ratio", "bar", "before", "change_pct")
PACKAGES = (
    "bayesdamp", "jax", "numpy", "scipy", "numba", "numpyro", "emcee", "blackjax", "pints", "nautilus-sampler",
    "dynesty", "diffrax",
)  # fmt: skip


@dataclass(frozen=True)
class Ledger:
    """Tables (header and rows) by title and ratios by name, of which larger is better, in the order in which they came;
    bars: what a ratio is wanted to be, where that was said."""

    tables: dict[str, tuple[Sequence[str], Sequence[Sequence[str]]]] = field(default_factory=dict)
    ratios: dict[str, float] = field(default_factory=dict)
    bars: dict[str, float] = field(default_factory=dict)


LEDGER = Ledger()


def ratio(name: str, value: float, bar: float | None = None) -> None:
    """Note how many times better ours is, and how many times it is wanted to be. Raises ValueError for exactly 1,
    which no two measurements give: it is one of them beside itself."""
    if value == 1.0:
        raise ValueError(f"{name}: a measurement was compared with itself")
    LEDGER.ratios[name] = float(value)
    if bar is not None:
        LEDGER.bars[name] = bar


def table(title: str, header: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a table, and keep it for the page."""
    LEDGER.tables[title] = (header, rows)
    print(f"\n{title}\n{_markdown(header, rows)}")


def write(ledger: Ledger, folder: Path) -> list[str]:
    """Write the page into a folder and return the losses against the run before. Ratios and tables that were not
    measured this time are kept from the time before."""
    folder.mkdir(parents=True, exist_ok=True)
    path, tables = folder / "ratios.csv", folder / "tables.json"
    kept = {row["name"]: row for row in (read_table(path) if path.is_file() else [])}
    before = {name: float(row["ratio"]) for name, row in kept.items()}
    bars = {name: float(row["bar"]) for name, row in kept.items() if row.get("bar")} | ledger.bars
    rows = []
    for name, value in (before | ledger.ratios).items():
        change = 100 * (value / before[name] - 1) if name in before else None
        rows.append(dict(zip(COLUMNS, (name, value, bars.get(name), before.get(name), change), strict=True)))
    write_table(path, COLUMNS, rows)
    write_json(tables, (json.loads(tables.read_text("utf-8")) if tables.is_file() else {}) | ledger.tables)
    write_json(folder / "machine.json", about := provenance(packages=PACKAGES))
    lost = [
        f"{row['name']}: {row['ratio']:.3g}, was {row['before']:.3g} ({row['change_pct']:.0f} %)"
        for row in rows
        if row["change_pct"] is not None and row["change_pct"] < -100 * LOSS
    ]
    page = _page(ledger, rows, json.loads(tables.read_text("utf-8")), lost, about["machine"])
    write_bytes(folder / "README.md", page.encode())
    return lost


def _page(
    ledger: Ledger,
    rows: Sequence[Mapping[str, Any]],
    tables: Mapping[str, Any],
    lost: Sequence[str],
    machine: Mapping[str, object],
) -> str:
    where = ", ".join(f"{name} {value}" for name, value in machine.items())
    barred = [row for row in rows if row["bar"] is not None]
    below = [f"- {r['name']}: {r['ratio']:.3g} of {r['bar']:g}" for r in barred if r["ratio"] < r["bar"]]
    cells = []
    for row in rows:
        earlier = "" if row["before"] is None else f"{row['before']:.3g}"
        bar = "" if row["bar"] is None else f"{row['bar']:g}"
        cells.append(
            [row["name"], f"{row['ratio']:.3g}", bar, earlier if row["name"] in ledger.ratios else "kept"]
        )
    parts = [
        "# Benchmarks",
        f"`make bench` writes this page. The last run was on one machine ({where}; more in `machine.json`). Times are "
        "CPU seconds of one thread where nothing else is said; both sides of such a ratio ran in turns in one process, "
        "the best of several.",
        f"{len(barred) - len(below)} of {len(barred)} ratios that have a bar reach it" + (":" if below else "."),
        "\n".join(below),
        f"Ratios that lost more than {100 * LOSS:.0f} % since the page before: {'' if lost else 'none.'}",
        "\n".join(f"- {line}" for line in lost),
        "## Ratios\nHow many times faster ours is, or how many times less it takes.",
        _markdown(["what", "ratio", "bar", "before"], cells),
        *(f"## {title}\n{_mark(title in ledger.tables)}{_markdown(*content)}" for title, content in tables.items()),
    ]  # fmt: skip
    return "\n\n".join(part for part in parts if part) + "\n"


def _mark(is_new: bool) -> str:
    return "" if is_new else "From a run before.\n\n"


def _markdown(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    return "\n".join("| " + " | ".join(line) + " |" for line in [header, ["---"] * len(header), *rows])
