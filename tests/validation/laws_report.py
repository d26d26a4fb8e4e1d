"""The page of the exponent and of the damping terms beside the paper's.

`python -m tests.validation.laws_report TABLE FOLDER [--seed 86000 --exponents 60 --each 6]`.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from scipy.stats import beta

from bayesdamp.inference.deviation.weighing import Weighing
from bayesdamp.interface.answer import WEIGHED, answer
from bayesdamp.physics.damping import all_sums
from tests.validation.laws import LEAST_NATS, case, nats_ahead
from validation.rows import gathered, shipped

EXPONENT = "exponent"
TERMS = ("cubic", "displacement", "power", "dry_position", "structural", "stribeck")
COLUMNS = (
    "case", "term", "truth", "share", "nats", "exponent", "exponent_low", "exponent_high", "first", "probability",
    "decided", "intervals", "held",
)  # fmt: skip
Rows = Sequence[Mapping[str, str]]


def row(term: str, seed: int) -> dict[str, object]:
    """The row of a record: its exponent where that is asked, else what is named and which intervals hold."""
    made = case(term, seed)
    head: dict[str, object] = {
        "case": f"{term}-{seed}",
        "term": term,
        "truth": made.damping,
        "share": made.share,
    }
    if term == EXPONENT:
        found = answer(made.signal, restoring=["linear"], sample=False).verdict.exponent
        low, value, high = (np.nan,) * 3 if found is None else (found.low, found.value, found.high)
        truth = made.values["exponent"]
        spans = {"exponent": value, "exponent_low": low, "exponent_high": high}
        return head | spans | {"truth": truth, "intervals": 1, "held": int(low <= truth <= high)}
    kept: dict[str, Weighing] = {}
    sums = [*all_sums(), term, f"viscous+{term}"]
    said = answer(made.signal, damping=sums, restoring=["linear"], made=kept).verdict
    order = [(said.probability, said.damping), *((r.probability, r.damping) for r in said.rivals)]
    own = [q for q in said.coefficients if q.name in made.values] if said.damping == made.damping else []
    return head | {
        "nats": nats_ahead(kept[WEIGHED], made) if WEIGHED in kept else np.nan,
        "first": max(order)[1], "probability": said.probability, "decided": int(said.decided), "intervals": len(own),
        "held": sum(q.low <= made.values[q.name] <= q.high for q in own),
    }  # fmt: skip


def interval(hits: int, count: int) -> str:
    """Hits of a count with the 95 % interval of their share (Clopper and Pearson 1934)."""
    if not count:
        return "–"
    low = beta.ppf(0.025, hits, count - hits + 1) if hits else 0.0
    high = beta.ppf(0.975, hits + 1, count - hits) if hits < count else 1.0
    return f"{hits} of {count} ({low:.2f}–{high:.2f})"


def page(rows: Rows) -> str:
    """The page, in Markdown."""
    exponents = [r for r in rows if r["term"] == EXPONENT]
    terms = {t: [r for r in rows if r["term"] == t] for t in TERMS}
    tellable = [r for r in rows if r["term"] != EXPONENT and float(r["nats"]) >= LEAST_NATS]
    of_these = sum(r["decided"] == "1" and r["first"] == r["truth"] for r in tellable)
    named = [r for r in rows if r["term"] != EXPONENT and r["decided"] == "1"]
    right = sum(r["first"] == r["truth"] for r in named)
    count = sum(map(len, terms.values()))
    lines = [
        "# The exponent, and damping terms beside the paper's",
        "",
        f"The exponent's 95 % interval holds the truth in {interval(_held(exponents), len(exponents))} power laws; of "
        f"{count} records of six further terms {len(named)} are named outright, {right} of these rightly; of the "
        f"{len(tellable)} of which anybody could tell the true sum, {of_these}.",
        "",
        "Records of the validation's own solver whose amplitude falls by 60 % or more with 0.5 to 2 % of noise; a "
        "term has at least 30 % of the loss, alone or beside viscous damping, and is weighed beside the paper's seven "
        "sums; its motions are sampled. Exponents are between 0.2 and 2.5. Anybody could tell where the true sum's "
        f"best fit is {LEAST_NATS:g} nats ahead of that of every sum that lacks one of its terms. In brackets: 95 % "
        f"intervals of the shares. {len(exponents)} exponents tell a coverage of 0.95 from one below "
        f"{_least(len(exponents)):.2f} (5 %) with a probability of 0.8.",
        "",
        "| term | first | with the right sum first | named without reservation, rightly | wrongly | "
        "rightly, where anybody could tell | "
        "intervals that hold |",
        "|---|---|---|---|---|---|---|",
    ]  # fmt: skip
    for term, own in terms.items():
        decided = [r for r in own if r["decided"] == "1"]
        good = sum(r["first"] == r["truth"] for r in decided)
        told = (
            interval(sum(term in r["first"].split("+") for r in own), len(own)),
            interval(sum(r["first"] == r["truth"] for r in own), len(own)),
            interval(good, len(own)),
            interval(len(decided) - good, len(own)),
            interval(
                sum(r in decided and r["first"] == r["truth"] for r in own if r in tellable),
                sum(r in tellable for r in own),
            ),
            f"{_held(own)} of {sum(int(r['intervals']) for r in own)}",
        )
        lines.append(f"| `{term}` | " + " | ".join(told) + " |")
    lines += [
        "",
        "laws.csv has every record. `make reports` makes it again, with `ARGS=--full` from three times as "
        "many.",
    ]
    return "\n".join(lines) + "\n"


def _held(rows: Rows) -> int:
    return sum(int(r["held"]) for r in rows)


def _least(count: int) -> float:
    """The coverage that so many records tell from 0.95 with a probability of 0.8, to the normal approximation."""
    for share in np.arange(0.94, 0.3, -0.01):
        if 0.95 - share > 1.96 * np.sqrt(0.95 * 0.05 / count) + 0.84 * np.sqrt(share * (1 - share) / count):
            return float(share)
    return 0.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("table", type=Path, help="a CSV; what it has is not done again")
    parser.add_argument("folder", type=Path, help="of the page")
    parser.add_argument("--seed", type=int, default=86000)
    parser.add_argument("--exponents", type=int, default=60)
    parser.add_argument("--each", type=int, default=6, help="records of each term")
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
