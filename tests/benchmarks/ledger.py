"""What the benchmarks measured, as a page: tables, ratios beside those of the run before, a picture, the machine."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from bayesdamp.store import provenance, read_table, write_bytes, write_json, write_table

LOSS = 0.2
"""Share of a ratio that must be lost for it to be shown as one."""
COLUMNS = ("name", "ratio", "before", "change_pct")
PAGE, RATIOS, MACHINE, PICTURE = "README.md", "ratios.csv", "machine.json", "ratios.png"
PACKAGES = ("bayesdamp", "jax", "numpy", "scipy", "numpyro", "emcee", "nautilus-sampler", "diffrax")


@dataclass(frozen=True)
class Ledger:
    """Tables (title, header, rows) and named ratios, of which larger is better, in the order in which they came."""

    tables: list[tuple[str, Sequence[str], Sequence[Sequence[str]]]] = field(default_factory=list)
    ratios: dict[str, float] = field(default_factory=dict)
    began: float = field(default_factory=time.perf_counter)


LEDGER = Ledger()


def ratio(name: str, value: float) -> None:
    """Note how many times better ours is."""
    LEDGER.ratios[name] = float(value)


def before(folder: Path) -> dict[str, float]:
    """The ratios of the page that is there; none where there is none."""
    path = folder / RATIOS
    return {row["name"]: float(row["ratio"]) for row in read_table(path)} if path.is_file() else {}


def losses(ratios: Mapping[str, float], earlier: Mapping[str, float]) -> list[str]:
    """A line for each ratio that has lost more than LOSS of what it was."""
    return [
        f"{name}: {value:.3g}, was {earlier[name]:.3g} ({100 * (value / earlier[name] - 1):.0f} %)"
        for name, value in ratios.items()
        if name in earlier and value < (1 - LOSS) * earlier[name]
    ]


def write(ledger: Ledger, folder: Path) -> list[str]:
    """Write the page into a folder and return the losses against what was there. Ratios that were not measured this
    time are kept from the time before."""
    folder.mkdir(parents=True, exist_ok=True)
    earlier = before(folder)
    lost = losses(ledger.ratios, earlier)
    kept = earlier | ledger.ratios
    rows = [
        {
            "name": name,
            "ratio": value,
            "before": earlier.get(name),
            "change_pct": 100 * (value / earlier[name] - 1) if name in earlier else None,
        }
        for name, value in kept.items()
    ]
    write_table(folder / RATIOS, COLUMNS, rows)
    about = provenance(packages=PACKAGES)
    write_json(folder / MACHINE, about)
    _draw(kept, folder / PICTURE)
    write_bytes(folder / PAGE, _page(ledger, kept, earlier, lost, about["machine"]).encode())
    return lost


def _page(
    ledger: Ledger,
    ratios: Mapping[str, float],
    earlier: Mapping[str, float],
    lost: Sequence[str],
    machine: Mapping[str, object],
) -> str:
    where = ", ".join(f"{name} {value}" for name, value in machine.items())
    parts = [
        "# Benchmarks",
        f"`make bench` wrote this page in {time.perf_counter() - ledger.began:.0f} s on one machine ({where}; more "
        f"in `{MACHINE}`). Both sides of a ratio ran in turns in one process, the best of several; seconds depend on "
        "the machine, ratios hardly do.",
        f"Ratios that lost more than {100 * LOSS:.0f} % since the page before: "
        + ("none." if not lost else "\n" + "\n".join(f"- {line}" for line in lost)),
        "## Ratios\nHow many times faster ours is, or how many times less it takes.",
        f"![Ratios, logarithmic]({PICTURE})",
        _table(
            ["what", "ratio", "before"],
            [[n, f"{v:.3g}", f"{earlier[n]:.3g}" if n in earlier else ""] for n, v in ratios.items()],
        ),
        *(f"## {title}\n{_table(header, rows)}" for title, header, rows in ledger.tables),
    ]
    return "\n\n".join(parts) + "\n"


def _table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def _draw(ratios: Mapping[str, float], path: Path) -> None:
    """Bars on a logarithmic axis."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8, 1 + 0.3 * len(ratios)), layout="constrained")
    axes = figure.add_subplot()
    names, values = list(ratios)[::-1], list(ratios.values())[::-1]
    axes.barh(names, values)
    axes.set_xscale("log")
    axes.axvline(1.0, color="black", linewidth=0.8)
    axes.set_xlabel("times better than the other")
    figure.savefig(path, dpi=120)
