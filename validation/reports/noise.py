"""Write the page on the estimators' errors in noise: `python -m validation.reports.noise FOLDER` (the run's folder)."""

from __future__ import annotations

import math
import sys
from pathlib import Path

from bayesdamp import formatting as fmt
from bayesdamp.formatting import markdown_table as table
from bayesdamp.report import words
from bayesdamp.report.results.estimators import (
    FACTORS,
    ErrorSeries,
    error_interval,
    error_series,
    rank_ranges,
)
from bayesdamp.report.results.run import RunFolder

INITIAL, REFINED = "initial", "refined"
"""Names of the two stages of an estimator: its own estimate, and the trajectory fit that starts at this estimate."""


def page(run: RunFolder) -> str:
    """Return the page in Markdown, from the folder of a run of the study `noise`."""
    every = error_series(run)
    along = next(s for s in every if s.factor == "noise")
    repeats = along.repeats.max()
    at = along.values.index(1.0)
    order = sorted(rank_ranges(along, INITIAL, at).items(), key=lambda item: item[1])
    first = [words.method(m) for m, (best, _) in order if best == 1]
    refined = along.errors.xs(REFINED, level="stage")[at] / along.bounds[at]
    lines = [
        "# Errors of the eleven estimators in noise",
        "",
        f"At 1 % of noise no method is better than {fmt.listing(first)} by more than chance; the errors of the "
        f"refined estimates of all methods are {refined.min():.2f} to {refined.max():.2f} times the Cramér–Rao bound.",
        "",
        f"The damping is viscous; every method estimates {repeats} repeats of each record. The tables give the root "
        "mean square error of ζ in per cent for the initial estimate of each method, with its 95 % interval "
        "(jackknife). A place is a range if the repeats do not distinguish methods; each pair is compared on the same "
        "records, at 2.5 % on each side. Errors that differ by a factor of "
        f"{math.exp(2.8 / math.sqrt(2 * repeats) * math.sqrt(2)):.1f} are distinguished with a probability of about "
        "0.8 if the errors of the methods are independent, and smaller differences if they are correlated.",
    ]
    for part in every:
        lines += ["", f"## {FACTORS[part.factor].capitalize()}", "", _table(part)]
    lines += ["", "estimates.csv has every estimate. `make reports` makes this report again."]
    return "\n".join(lines) + "\n"


def _table(part: ErrorSeries) -> str:
    """Return a Markdown table of each method's error (%) and range of ranks, along one factor such as the noise."""
    order = [rank_ranges(part, INITIAL, i) for i in range(len(part.values))]
    lines = []
    for method in sorted(part.errors.xs(INITIAL, level="stage").index):
        cells = []
        for i in range(len(part.values)):
            own = part.of(method, INITIAL, i)
            low, high = error_interval(own)
            place = order[i].get(method)
            span = f" ({low:.2g}–{high:.2g})" if math.isfinite(low) else ""
            error = f"{part.errors.at[(method, INITIAL), i]:.2g}{span}" if own else "no answer"
            cells.append(error + (f", place {place[0]}–{place[1]}" if place else ""))
        lines.append([words.method(method), *cells])
    bounds = [f"{b:.2g}" if math.isfinite(b) else "–" for b in part.bounds]
    return table(["method", *(f"{v:g}" for v in part.values)], [*lines, ["*Cramér–Rao bound*", *bounds]])


def main(folder: Path) -> None:
    """Write README.md into the folder of a run of the study `noise`."""
    (folder / "README.md").write_text(page(RunFolder(folder)), encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
