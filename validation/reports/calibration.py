"""The pages of calibrations and model recoveries: `python -m validation.reports.calibration FOLDER`, where the run is.

They say what so many records can decide: the size of an effect that a test would find.
"""

from __future__ import annotations

import json
import sys
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import binom, binomtest, norm

from bayesdamp.calibrate.tables import ALARM
from bayesdamp.report.markup import markdown_table as table
from validation.rows import read_rows

LEVEL = 0.95
POWER = 0.8
"""The probability with which an effect is to be found (conventional)."""


@lru_cache
def rejected(n: int, level: float, alarm: float) -> np.ndarray:
    """Which counts (n + 1,) of n intervals that hold the truth a two-sided exact binomial test rejects."""
    return np.array([binomtest(k, n, level).pvalue < alarm for k in range(n + 1)])


def power(n: int, level: float, alarm: float, width: float) -> float:
    """Probability that n normal intervals, `width` times as wide as they should be, are rejected at `alarm`."""
    inside = 2 * norm.cdf(width * norm.ppf(0.5 + 0.5 * level)) - 1
    return float(binom.pmf(np.arange(n + 1), n, inside)[rejected(n, level, alarm)].sum())


def narrowest_passed(n: int, level: float, alarm: float) -> float:
    """The largest relative width below 1 of intervals that would be found with probability `POWER`; 0 where none is."""
    percents = (percent / 100 for percent in range(99, 0, -1))
    return next((width for width in percents if power(n, level, alarm, width) >= POWER), 0.0)


def calibration(run: dict[str, Any], rows: list[dict[str, str]]) -> str:
    """The page of a calibration, in Markdown, from run.json and the rows of calibration.csv."""
    result = run["result"]
    posterior, classical = (result["families"][name] for name in ("posterior", "classical"))
    counts = {model: int(one["counted"]) for model, one in result["counts"].items()}
    fewest = min(counts.values())
    single = narrowest_passed(fewest, LEVEL, 0.05)
    whole = narrowest_passed(fewest, LEVEL, ALARM / max(posterior["tests"], 1))
    lines = []
    for model, count in counts.items():
        own = [
            float(r["value"]) for r in rows
            if r["model"] == model and r["method"] == "nuts" and r["level"] == str(LEVEL)
        ]  # fmt: skip
        shares = f"{min(own):.3f} to {max(own):.3f}" if own else "–"
        lines.append([model, str(count), str(result["counts"][model]["tried"]), shares])
    held = "share of NUTS's 95 % intervals that hold, least and largest over parameters"
    return f"""# Are the intervals right?

Of {posterior["tests"]} checks of posteriors on {sum(counts.values())} records {posterior["wrong"]} fail, of \
{classical["tests"]} of refined estimates {classical["wrong"]}; a false alarm anywhere in either has a chance \
of {ALARM:.0%}.

Each record has its parameters, noise included, drawn from the priors that it is then inferred with \
({run["description"].rstrip(".")}); the ranks of the truth among the draws of NUTS and emcee are then uniform \
(Talts et al. 2018), and so many intervals hold it as they say. By Holm over a table. With {fewest} records a \
damping, 95 % intervals of one parameter that are {1 - single:.0%} too narrow in every record fail a check by \
itself (5 %) with a probability of {POWER:g}, and the whole table where they are {1 - whole:.0%} too narrow.

{table(["damping", "records", "tried", held], lines)}

A record that shows no oscillation is left out before anything is sampled, which a posterior, being conditional \
on its record, does not mind; none is left out for what a sampler says. report.html has the histograms of the \
ranks and the bands, calibration.csv every check, ranks.csv every rank. `make reports` makes it again, with \
`ARGS=--full` from eight times as many records.
"""


def recovery(run: dict[str, Any]) -> str:
    """The page of a model recovery, in Markdown, from run.json."""
    found = run["result"]["recovery"]
    hits = found["hits"]
    n = hits["records"]
    seen = (norm.ppf(POWER) + norm.ppf(0.975)) * hits["sd"] / n if n else np.nan
    lines = [
        [
            f"{row['from']:g} to {row['to']:g}", str(row["records"]), f"{row['probability']:.2f}",
            f"{row['share']:.2f}", f"{row['low']:.2f} to {row['high']:.2f}",
        ]
        for row in found["bins"]
    ]  # fmt: skip
    heads = ["highest probability", "records", "its mean", "share true"]
    refused = "; ".join(f"{count} × {why}" for why, count in found["refused"].items()) or "none"
    return f"""# Are the probabilities right?

Of {n} records the most probable damping is the true one in {hits["hits"]}; the probabilities promised \
{hits["expected"]:.1f} ± {hits["sd"]:.1f}.

Records of all seven sums in turn, their parameters drawn from the priors ({run["description"].rstrip(".")}), \
weighed by importance sampling, the laws taken to hold exactly. Two-sided p value of the number: \
{hits["p"]:.2g}. With so many records, probabilities of the first that are {100 * seen:.0f} percentage points \
too high or too low on average are found (5 %) with a probability of {POWER:g}. Mean log probability of the \
truth: {found["log_score"]:.3f}, promised {found["log_score_expected"]:.3f}, by chance \
{found["log_score_ignorant"]:.3f}.

{table([*heads, f"{1 - ALARM:.0%} band, all bins together"], lines)}

{found["tried"]} were tried; refused: {refused}. recovery.csv has every record. `make reports` makes it again, \
with `ARGS=--full` from ten times as many.
"""


def main(folder: Path) -> None:
    """Write README.md beside the tables of a run."""
    run = json.loads((folder / "run.json").read_text(encoding="utf-8"))
    is_recovery = run["kind"] == "model recovery"
    page = recovery(run) if is_recovery else calibration(run, read_rows(folder / "calibration.csv"))
    (folder / "README.md").write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
