"""Write the page on the exponent and on the damping terms that the paper does not have.

`python -m validation.experiments.laws_report TABLE FOLDER [--seed 86000 --exponents 60 --each 6]`.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from scipy.stats import binomtest

from bayesdamp.inference.deviation.weighing import Weighing
from bayesdamp.interface.answer import WEIGHED, answer
from validation.experiments.laws import (
    EXPONENT,
    LEAST_NATS,
    case,
    first_sum,
    intervals_inside,
    nats_ahead,
    verdict_on,
)
from validation.rows import gathered, shipped

TERMS = ("cubic", "displacement", "power", "dry_position", "structural", "stribeck")
COLUMNS = (
    "case", "term", "truth", "share", "nats", "exponent", "exponent_low", "exponent_high", "first", "probability",
    "decided", "intervals", "held",
)  # fmt: skip
Rows = Sequence[Mapping[str, str]]


def row(term: str, seed: int) -> dict[str, object]:
    """Return the row of a record: the exponent of a power law, or the most probable sum and its intervals."""
    c = case(term, seed)
    head = {"case": f"{term}-{seed}", "term": term, "share": c.share}
    if term == EXPONENT:
        e = answer(c.signal, restoring=["linear"], sample=False).verdict.exponent
        low, value, high = (np.nan,) * 3 if e is None else (e.low, e.value, e.high)
        truth = c.values["exponent"]
        return head | {
            "truth": truth, "exponent": value, "exponent_low": low, "exponent_high": high, "intervals": 1,
            "held": int(low <= truth <= high),
        }  # fmt: skip
    results: dict[str, Weighing] = {}
    verdict = verdict_on(c, term, True, results)
    inside = intervals_inside(verdict, c)
    return head | {
        "truth": c.damping, "nats": nats_ahead(results[WEIGHED], c) if WEIGHED in results else np.nan,
        "first": first_sum(verdict), "probability": verdict.probability, "decided": int(verdict.decided),
        "intervals": len(inside), "held": sum(inside.values()),
    }  # fmt: skip


def interval(hits: int, count: int) -> str:
    """Format hits of a count with the 95 % interval of their share (Clopper and Pearson 1934)."""
    if not count:
        return "–"
    share = binomtest(hits, count).proportion_ci()
    return f"{hits} of {count} ({share.low:.2f}–{share.high:.2f})"


def page(rows: Rows) -> str:
    """Return the page in Markdown."""
    exponents = [r for r in rows if r["term"] == EXPONENT]
    others = [r for r in rows if r["term"] != EXPONENT]
    distinct = [r for r in others if float(r["nats"]) >= LEAST_NATS]
    named = [r for r in others if r["decided"] == "1"]
    right = [r for r in named if r["first"] == r["truth"]]
    lines = [
        "# The exponent, and damping terms beside the paper's",
        "",
        f"The exponent's 95 % interval holds the truth in {interval(_inside(exponents), len(exponents))} power laws; "
        f"of {len(others)} records of six further terms {len(named)} are named outright, {len(right)} of these "
        f"rightly; of the {len(distinct)} of which anybody could tell the true sum, "
        f"{sum(r in right for r in distinct)}.",
        "",
        "Records of the validation's own solver whose amplitude falls by 60 % or more with 0.5 to 2 % of noise; a "
        "term has at least 30 % of the loss, alone or beside viscous damping, and is weighed beside the paper's seven "
        "sums; its motions are sampled. Exponents are between 0.2 and 2.5. Anybody could tell where the true sum's "
        f"best fit is {LEAST_NATS:g} nats ahead of that of every sum that lacks one of its terms. In brackets: 95 % "
        f"intervals of the shares. {len(exponents)} exponents tell a coverage of 0.95 from one below "
        f"{_least(len(exponents)):.2f} (5 %) with a probability of 0.8.",
        "",
        "| term | first | with the right sum first | named without reservation, rightly | wrongly | "
        "rightly, where anybody could tell | intervals that hold |",
        "|---|---|---|---|---|---|---|",
    ]  # fmt: skip
    for term in TERMS:
        own = [r for r in others if r["term"] == term]
        good, clear = [r for r in own if r in right], [r for r in own if r in distinct]
        cells = (
            interval(sum(term in r["first"].split("+") for r in own), len(own)),
            interval(sum(r["first"] == r["truth"] for r in own), len(own)),
            interval(len(good), len(own)),
            interval(sum(r in named for r in own) - len(good), len(own)),
            interval(sum(r in good for r in clear), len(clear)),
            f"{_inside(own)} of {sum(int(r['intervals']) for r in own)}",
        )
        lines.append(f"| `{term}` | " + " | ".join(cells) + " |")
    lines += [
        "",
        "laws.csv has every record. `make reports` makes it again, with `ARGS=--full` from three times as many.",
    ]
    return "\n".join(lines) + "\n"


def _inside(rows: Rows) -> int:
    return sum(int(r["held"]) for r in rows)


def _least(count: int) -> float:
    """Return the coverage that differs significantly from 0.95 with a probability of 0.8, in normal approximation."""
    for share in np.arange(0.94, 0.3, -0.01):
        if 0.95 - share > 1.96 * np.sqrt(0.95 * 0.05 / count) + 0.84 * np.sqrt(share * (1 - share) / count):
            return float(share)
    return 0.0


def main() -> None:
    """Answer the records that the table lacks; write README.md and laws.csv into the folder."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("table", type=Path, help="CSV file of the rows; missing rows are added")
    parser.add_argument("folder", type=Path, help="folder of the page")
    parser.add_argument("--seed", type=int, default=86000)
    parser.add_argument("--exponents", type=int, default=60)
    parser.add_argument("--each", type=int, default=6, help="number of records of each term")
    parser.add_argument("--workers", type=int, default=2)
    given = parser.parse_args()
    wanted = {EXPONENT: given.exponents, **dict.fromkeys(TERMS, given.each)}
    todo = {
        f"{term}-{seed}": (term, seed)
        for k, (term, count) in enumerate(wanted.items())
        for seed in range(given.seed + 1000 * k, given.seed + 1000 * k + count)
    }
    rows = gathered(given.table, COLUMNS, todo, row, given.workers)
    shipped(given.folder / "laws.csv", COLUMNS, rows)
    (given.folder / "README.md").write_text(page(rows), encoding="utf-8")


if __name__ == "__main__":
    main()
