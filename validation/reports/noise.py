"""Write the page on the estimators' errors in noise: `python -m validation.reports.noise FOLDER` (the run's folder)."""

import sys
from pathlib import Path

from bayesdamp import formatting as fmt
from bayesdamp.report import words
from bayesdamp.report.results.estimators import error_series, rank_ranges
from bayesdamp.report.results.run import RunFolder

INITIAL, REFINED = "initial", "refined"
"""Names of the two results of an estimator: its own estimate, and the trajectory fit that starts from it."""


def page(run: RunFolder) -> str:
    """Return the page in Markdown, from the folder of a run of the study `noise`."""
    along = next(s for s in error_series(run) if s.factor == "noise")
    at = along.values.index(1.0)
    order = sorted(rank_ranges(along, INITIAL, at).items(), key=lambda item: item[1])
    first = [words.method(m) for m, (best, _) in order if best == 1]
    refined = along.errors.xs(REFINED, level="stage")[at] / along.bounds[at]
    ends = dict.fromkeys(f"{ratio:.2f}" for ratio in (refined.min(), refined.max()))
    return f"""# Errors of the eleven estimators in noise

At 1 % of noise no method is better than {fmt.listing(first)} by more than chance; the errors of the refined estimates \
of all methods are {" to ".join(ends)} times the Cramér–Rao bound.

The damping is viscous; estimates.csv has every estimate. `make reports` makes this report again.
"""


def main(folder: Path) -> None:
    """Write README.md into the folder of a run of the study `noise`."""
    (folder / "README.md").write_text(page(RunFolder(folder)), encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
