"""What the benchmarks measured, as a page: tables, ratios beside those of the run before, a picture, the machine."""

from __future__ import annotations

import json
import re
import time
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from bayesdamp.store import provenance, read_table, write_bytes, write_json, write_table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LOSS = 0.2
"""Share of a ratio that must be lost for it to be shown as one."""
COLUMNS = ("name", "ratio", "bar", "before", "change_pct")
PAGE, RATIOS, MACHINE, PICTURE, TABLES = (
    "README.md",
    "ratios.csv",
    "machine.json",
    "ratios.png",
    "tables.json",
)
FROM_BEFORE = "From a run before.\n\n"
PACKAGES = (
    "bayesdamp", "jax", "numpy", "scipy", "numba", "numpyro", "emcee", "blackjax", "pints", "nautilus-sampler",
    "dynesty", "diffrax",
)  # fmt: skip


@dataclass(frozen=True)
class Ledger:
    """Tables (title, header, rows) and named ratios, of which larger is better, in the order in which they came; bars:
    what a ratio is wanted to be, where that was said; figures: of tables, by title."""

    tables: list[tuple[str, Sequence[str], Sequence[Sequence[str]]]] = field(default_factory=list)
    ratios: dict[str, float] = field(default_factory=dict)
    bars: dict[str, float] = field(default_factory=dict)
    figures: dict[str, Figure] = field(default_factory=dict)
    began: float = field(default_factory=time.perf_counter)


LEDGER = Ledger()


def ratio(name: str, value: float, bar: float | None = None) -> None:
    """Note how many times better ours is, and how many times it is wanted to be. Raises ValueError for exactly 1,
    which no two measurements give: it is one of them beside itself."""
    if value == 1.0:
        raise ValueError(f"{name}: a measurement was compared with itself")
    LEDGER.ratios[name] = float(value)
    if bar is not None:
        LEDGER.bars[name] = bar


def before(folder: Path) -> dict[str, float]:
    """The ratios of the page that is there; none where there is none."""
    return _column(folder, "ratio")


def _column(folder: Path, column: str) -> dict[str, float]:
    path = folder / RATIOS
    rows = read_table(path) if path.is_file() else []
    return {row["name"]: float(row[column]) for row in rows if row.get(column)}


def losses(ratios: Mapping[str, float], earlier: Mapping[str, float]) -> list[str]:
    """A line for each ratio that has lost more than LOSS of what it was."""
    return [
        f"{name}: {value:.3g}, was {earlier[name]:.3g} ({100 * (value / earlier[name] - 1):.0f} %)"
        for name, value in ratios.items()
        if name in earlier and value < (1 - LOSS) * earlier[name]
    ]


def write(
    ledger: Ledger,
    folder: Path,
    files: Sequence[str] = (),
    every: Sequence[str] = (),
    earlier: Mapping[str, float] | None = None,
) -> list[str]:
    """Write the page into a folder and return the losses against the run before. Ratios and tables that were not
    measured this time are kept from the time before. files: that were run to their end, every: that there are;
    earlier: the ratios of the run before, by default those of the page that is there."""
    folder.mkdir(parents=True, exist_ok=True)
    earlier = before(folder) if earlier is None else earlier
    lost = losses(ledger.ratios, earlier)
    kept, bars = {**earlier, **ledger.ratios}, _column(folder, "bar") | ledger.bars
    known = json.loads((folder / TABLES).read_text("utf-8")) if (folder / TABLES).is_file() else {}
    tables = known | {
        title: [list(header), [list(row) for row in rows]] for title, header, rows in ledger.tables
    }
    write_json(folder / TABLES, tables)
    rows = [
        {
            "name": name,
            "ratio": value,
            "bar": bars.get(name),
            "before": earlier.get(name),
            "change_pct": 100 * (value / earlier[name] - 1) if name in earlier else None,
        }
        for name, value in kept.items()
    ]
    write_table(folder / RATIOS, COLUMNS, rows)
    about = provenance(packages=PACKAGES)
    write_json(folder / MACHINE, about)
    _draw(kept, bars, folder / PICTURE)
    for title, figure in ledger.figures.items():
        figure.savefig(folder / _file(title), dpi=120)
    drawn = {
        title: f"![{title}]({_file(title)})\n\n" for title in tables if (folder / _file(title)).is_file()
    }
    seconds = time.perf_counter() - ledger.began
    anew = {title for title, _, _ in ledger.tables} | set(ledger.ratios)
    page = _page(
        _run(seconds, files, every), tables, drawn, kept, bars, earlier, lost, about["machine"], anew
    )
    write_bytes(folder / PAGE, page.encode())
    return lost


def _run(seconds: float, files: Sequence[str], every: Sequence[str]) -> str:
    """What of the page the last run measured."""
    missing = [name for name in every if name not in files]
    if not missing:
        return f"The last run measured all of it, in {seconds:.0f} s"
    return (
        f"The last run, of {seconds:.0f} s, was not a whole one: {', '.join(missing)} did not run to the end in it. "
        "What is here of these is from a run before, and marked so. It was"
    )


def _page(
    run: str,
    tables: Mapping[str, Sequence[Sequence[str]]],
    drawn: Mapping[str, str],
    ratios: Mapping[str, float],
    bars: Mapping[str, float],
    earlier: Mapping[str, float],
    lost: Sequence[str],
    machine: Mapping[str, object],
    anew: Set[str],
) -> str:
    """The page. drawn: pictures of tables, by title; anew: titles and names of what this run measured."""
    where = ", ".join(f"{name} {value}" for name, value in machine.items())
    below = [n for n, bar in bars.items() if n in ratios and ratios[n] < bar]
    parts = [
        "# Benchmarks",
        f"`make bench` writes this page. {run}, on one machine ({where}; more in `{MACHINE}`). Times are CPU seconds "
        "of one thread where nothing else is said; both sides of such a ratio ran in turns in one process, the best "
        "of several.",
        f"{len(bars) - len(below)} of {len(bars)} ratios that have a bar reach it"
        + (
            "."
            if not below
            else "; below it:\n" + "\n".join(f"- {n}: {ratios[n]:.3g} of {bars[n]:g}" for n in below)
        ),
        f"Ratios that lost more than {100 * LOSS:.0f} % since the page before: "
        + ("none." if not lost else "\n" + "\n".join(f"- {line}" for line in lost)),
        "## Ratios\nHow many times faster ours is, or how many times less it takes.",
        f"![Ratios, logarithmic, their bars as lines]({PICTURE})",
        _table(
            ["what", "ratio", "bar", "before"],
            [
                [
                    n,
                    f"{v:.3g}",
                    f"{bars[n]:g}" if n in bars else "",
                    ("kept" if n not in anew else f"{earlier[n]:.3g}") if n in earlier else "",
                ]
                for n, v in ratios.items()
            ],
        ),
        *(
            f"## {title}\n{'' if title in anew else FROM_BEFORE}{drawn.get(title, '')}{_table(header, rows)}"
            for title, (header, rows) in tables.items()
        ),
    ]
    return "\n\n".join(parts) + "\n"


def _file(title: str) -> str:
    """Where a table's picture is."""
    return re.sub(r"\W+", "-", title.lower()).strip("-") + ".png"


def _table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def _draw(ratios: Mapping[str, float], bars: Mapping[str, float], path: Path) -> None:
    """Bars on a logarithmic axis, with a line where each is wanted to reach."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 1 + 0.3 * len(ratios)), layout="constrained")
    axes = figure.add_subplot()
    names, values = list(ratios)[::-1], list(ratios.values())[::-1]
    axes.barh(names, values)
    for place, name in enumerate(names):
        if name in bars:
            axes.plot([bars[name]] * 2, [place - 0.45, place + 0.45], color="tab:red", linewidth=2)
    axes.set_xscale("log")
    axes.axvline(1.0, color="black", linewidth=0.8)
    axes.set_xlabel("times better than the other (red: wanted)")
    figure.savefig(path, dpi=120)
