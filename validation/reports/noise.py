"""The page of errors in noise: `python -m validation.reports.noise FOLDER`, where the run is."""

from __future__ import annotations

import math
import sys
from pathlib import Path

from bayesdamp import formatting as fmt
from bayesdamp.report import words
from bayesdamp.report.markup import markdown_table as table
from bayesdamp.report.results.run import RunFolder
from bayesdamp.report.results.sweeping import FACTORS, ErrorSeries, interval, places, series

INITIAL, REFINED = "initial", "refined"


def page(run: RunFolder) -> str:
    """The page, in Markdown, from a run's folder."""
    found = series(run)
    along = next(s for s in found if s.factor == "noise")
    repeats = max(tried for own in along.answers.values() for _, tried in own)
    at = along.values.index(1.0)
    order = sorted(places(along, INITIAL, at).items(), key=lambda one: one[1])
    first = [words.method(m) for m, (best, _) in order if best == 1]
    refined = [e[at] / along.bounds[at] for (_, s), e in along.errors.items() if s == REFINED]
    lines = [
        "# Errors of the eleven estimators in noise",
        "",
        f"At 1 % of noise no method is ahead of {fmt.listing(first)} beyond luck; the refined "
        "estimates of all methods "
        f"have {min(refined):.2f} to {max(refined):.2f} of the Cramér–Rao bound.",
        "",
        f"Viscous damping, {repeats} repeats of each record for every method. Root mean square "
        "error of ζ in per cent of "
        "each method's own estimate, with its 95 % interval (jackknife); places as far as the "
        "repeats tell methods apart: "
        "each pair at 2.5 % to a side, on the same records. Errors that differ by a factor of "
        f"{math.exp(2.8 / math.sqrt(2 * repeats) * math.sqrt(2)):.1f} are told apart with a probability of "
        "about 0.8 "
        "where the methods err independently, and smaller ones where they err together.",
    ]
    for one in found:
        lines += ["", f"## {FACTORS[one.factor].capitalize()}", "", _table(one)]
    lines += ["", "estimates.csv has every estimate. `make reports` makes it again."]
    return "\n".join(lines) + "\n"


def _table(found: ErrorSeries) -> str:
    order = [places(found, INITIAL, i) for i in range(len(found.values))]
    lines = []
    for method in sorted({m for m, s in found.errors if s == INITIAL}):
        cells = []
        for i in range(len(found.values)):
            own = found.each[method, INITIAL][i]
            low, high = interval(own)
            place = order[i].get(method)
            span = f" ({low:.2g}–{high:.2g})" if math.isfinite(low) else ""
            said = f"{found.errors[method, INITIAL][i]:.2g}{span}" if own else "no answer"
            cells.append(said + (f", place {place[0]}–{place[1]}" if place else ""))
        lines.append([words.method(method), *cells])
    bounds = [f"{b:.2g}" if math.isfinite(b) else "–" for b in found.bounds]
    return table(["method", *(f"{v:g}" for v in found.values)], [*lines, ["*Cramér–Rao bound*", *bounds]])


def main(folder: Path) -> None:
    """Write README.md beside a study's tables."""
    (folder / "README.md").write_text(page(RunFolder(folder)), encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
