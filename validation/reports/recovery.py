"""The page of a model recovery: `python -m validation.reports.recovery FOLDER`, where the run is."""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from typing import Any

from bayesdamp.calibrate.tables import ALARM
from validation.reports.power import POWER

Z_POWER, Z_ALARM = 0.8416, 1.96
"""Normal quantiles of `POWER`, and of 2.5 % on each side."""


def page(run: dict[str, Any]) -> str:
    """The page, in Markdown, from run.json."""
    found = run["result"]["recovery"]
    hits = found["hits"]
    n = hits["records"]
    seen = (Z_POWER + Z_ALARM) * hits["sd"] / n if n else math.nan
    lines = [
        "# Are the probabilities right?",
        "",
        f"Of {n} records the most probable damping is the true one in {hits['hits']}; the probabilities "
        "promised "
        f"{hits['expected']:.1f} ± {hits['sd']:.1f}.",
        "",
        "Records of all seven sums in turn, their parameters drawn from the priors "
        f"({run['description'].rstrip('.')}), "
        "weighed by importance sampling, the laws taken to hold exactly. Two-sided p value of the number: "
        f"{hits['p']:.2g}. With so many records, probabilities of the first that are {100 * seen:.0f} "
        "percentage points "
        f"too high or too low on average are found (5 %) with a probability of {POWER:g}. Mean log "
        "probability of the "
        f"truth: {found['log_score']:.3f}, promised {found['log_score_expected']:.3f}, by chance "
        f"{found['log_score_ignorant']:.3f}.",
        "",
        f"| highest probability | records | its mean | share true | {1 - ALARM:.0%} band, all bins together "
        "|",
        "|---|---|---|---|---|",
    ]
    for row in found["bins"]:
        lines.append(
            f"| {row['from']:g} to {row['to']:g} | {row['records']} | {row['probability']:.2f} | "
            f"{row['share']:.2f} | "
            f"{row['low']:.2f} to {row['high']:.2f} |"
        )
    lines += [
        "",
        f"{found['tried']} were tried; refused: "
        + ("; ".join(f"{count} × {why}" for why, count in found["refused"].items()) or "none")
        + ". recovery.csv has every record. `make reports` makes it again, with `ARGS=--full` from ten times as many.",
    ]
    return "\n".join(lines) + "\n"


def main(folder: Path) -> None:
    """Write README.md beside a recovery's tables."""
    run = json.loads((folder / "run.json").read_text(encoding="utf-8"))
    (folder / "README.md").write_text(page(run), encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
