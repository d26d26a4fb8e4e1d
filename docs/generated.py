"""Tables of the site that follow from measurements in reports/ and from the source.

Written anew at each build.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from pathlib import Path

import pandas as pd

from bayesdamp.estimators import ESTIMATORS, names_for_all
from bayesdamp.estimators.shared import table as taken
from bayesdamp.physics.damping import PAPER_TERMS, others

DAMPINGS = {"viscous": "zeta", "coulomb": "mu_c", "quadratic": "mu_q"}
SETTINGS = {
    "noise-0p1": "0.1 %",
    "base": "1 %",
    "noise-3p0": "3 %",
    "noise-10p0": "10 %",
    "sampling-10": "10 samples a period",
    "length-1p5": "1.5 periods",
}
"""Cells of studies/noise.toml, and what they change."""


QUESTIONS = {
    "calibration": (
        "Are the intervals right, if the law is?",
        "ranks of the truth in posteriors of records drawn from the priors",
    ),
    "model_recovery": (
        "Are the probabilities right, if one law is?",
        "records of seven sums drawn from the priors",
    ),
    "deviation": (
        "What is the quick answer worth?",
        "fresh seeds, laws that hold and laws that do not",
    ),
    "misfit": (
        "What if no law is right?",
        "fifteen kinds: drift, beats, clipping, cubic damping, …",
    ),
    "laws": (
        "Which further terms are recognised?",
        "six terms by another solver",
    ),
    "noise": (
        "Which estimator in noise?",
        "eleven methods on the same records, as many repeats each",
    ),
    "measured": (
        "And on real records?",
        "decays that others measured; no truth is known",
    ),
    "claims.md": (
        "Do the paper's claims hold?",
        "each measured",
    ),
}
"""A folder or page of reports/: the question that it answers, and how it was tested."""


def markdown(header: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """A table in Markdown."""
    head = list(header)
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines) + "\n"


def terms_taken() -> str:
    """Which estimator estimates which damping term, and why the others do not, as the program has it."""
    terms = [*PAPER_TERMS, *others()]
    rows = taken([ESTIMATORS.get(n) for n in names_for_all()], terms)
    said: dict[str, int] = {}
    lines = []
    for name, why in rows:
        plain = [w and w.replace(f"{t} damping", "the term") for t, w in zip(terms, why, strict=True)]
        notes = [said.setdefault(w, len(said) + 1) if w else 0 for w in plain]
        lines.append((f"`{name}`", *(f"({n})" if n else "yes" for n in notes)))
    reasons = "".join(f"{i}. {why}\n" for why, i in said.items())
    return markdown(("", *(f"`{t}`" for t in terms)), lines) + "\n" + reasons


def number(value: float) -> str:
    """Two digits; a dash for none."""
    if math.isnan(value):
        return "–"
    if value < 1e-3:
        return f"{value:.0e}".replace("e-0", "e-")
    return f"{value:.2g}"


def errors_in_noise(estimates: pd.DataFrame, stage: str) -> dict[str, dict[str, float]]:
    """Method, setting: the median of |error| in per cent over repeats; NaN where no repeat has an estimate."""
    found = estimates[(estimates.parameter == "zeta") & (estimates.stage == stage)]
    found = found.assign(size=found.error_pct.abs())
    table = found.pivot_table(index="estimator", columns="signal", values="size", aggfunc="median")
    return {
        str(m): {s: float(table.at[m, s]) if s in table else math.nan for s in SETTINGS} for m in table.index
    }


def repeats_of(estimates: pd.DataFrame) -> Mapping[str, int]:
    """How many repeats of the base record each method was given."""
    base = estimates[estimates.signal == "base"]
    return {str(m): int(n) for m, n in base.groupby("estimator").repeat.nunique().items()}


def clean_errors(estimates: pd.DataFrame) -> dict[str, dict[str, float]]:
    """Method: initial error in per cent on the paper's three clean records, and seconds for the three."""
    found: dict[str, dict[str, float]] = {}
    initial = estimates[estimates.stage == "initial"]
    for method, rows in initial.groupby("estimator"):
        own = {}
        seconds = 0.0
        for damping, parameter in DAMPINGS.items():
            one = rows[
                (rows.signal == damping) & (rows.model == damping) & (rows.parameter == parameter)
            ].iloc[0]
            own[damping] = abs(float(one.error_pct))
            seconds += float(one.seconds)
        found[str(method)] = own | {"seconds": seconds}
    return found


def escaped(rows: Iterable[Iterable[str]]) -> list[list[str]]:
    """Cells in which a bar does not end the cell."""
    return [[cell.replace("|", "\\|") for cell in row] for row in rows]


def found_in(page: str) -> str:
    """The answer of a report's page: its first paragraph behind the title."""
    parts = page.partition("\n")[2].strip().split("\n\n")
    return " ".join(parts[0].split())


def validated(root: Path) -> str:
    """Every question, how it was tested and what was found, from the reports' own pages."""
    rows = []
    for name, (question, how) in QUESTIONS.items():
        path = root / "reports" / name
        page = path if path.suffix else path / "README.md"
        if page.is_file():
            rows.append((question, how, found_in(page.read_text(encoding="utf-8")), f"`reports/{name}`"))
    return markdown(("question", "how it was tested", "found", "where"), escaped(rows))


def tables(root: Path) -> dict[str, str]:
    """File name to text."""
    noise = pd.read_csv(root / "reports/noise/estimates.csv")
    repeats, initial = repeats_of(noise), errors_in_noise(noise, "initial")
    order = sorted(initial, key=lambda m: initial[m]["base"])
    in_noise = markdown(
        ("method", *SETTINGS.values(), "repeats"),
        ((f"`{m}`", *(number(initial[m][s]) for s in SETTINGS), str(repeats[m])) for m in order),
    )
    refined = errors_in_noise(noise, "refined")
    after = markdown(
        ("", *SETTINGS.values()),
        [
            (
                label,
                *(
                    number(pick([refined[m][s] for m in refined if not math.isnan(refined[m][s])]))
                    for s in SETTINGS
                ),
            )
            for label, pick in (("least of all methods", min), ("largest", max))
        ],
    )
    clean = clean_errors(pd.read_csv(root / "reports/paper/estimates.csv"))
    exact = markdown(
        ("method", *DAMPINGS, "seconds for the three"),
        (
            (f"`{m}`", *(number(clean[m][d]) for d in DAMPINGS), f"{clean[m]['seconds']:.1f}")
            for m in sorted(clean, key=lambda m: max(clean[m][d] for d in DAMPINGS))
        ),
    )
    return {
        "methods_noise.md": in_noise,
        "methods_refined.md": after,
        "methods_clean.md": exact,
        "methods_terms.md": terms_taken(),
        "validation.md": validated(root),
    }


def write(root: Path) -> None:
    """All generated tables, below docs/_generated."""
    folder = root / "docs" / "_generated"
    folder.mkdir(exist_ok=True)
    for name, text in tables(root).items():
        path = folder / name
        if not path.is_file() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")
