"""The page of a calibration: `python -m validation.reports.calibration FOLDER`, where the run is."""

from __future__ import annotations

import csv
import json
import sys
from pathlib import Path
from typing import Any

from bayesdamp.calibrate.tables import ALARM
from validation.reports.power import POWER, narrowest_passed

LEVEL = 0.95


def page(run: dict[str, Any], rows: list[dict[str, str]]) -> str:
    """The page, in Markdown, from run.json and the rows of calibration.csv."""
    result = run["result"]
    posterior, classical = (result["families"][name] for name in ("posterior", "classical"))
    counts = {model: int(one["counted"]) for model, one in result["counts"].items()}
    fewest = min(counts.values())
    single = narrowest_passed(fewest, LEVEL, 0.05)
    table = narrowest_passed(fewest, LEVEL, ALARM / max(posterior["tests"], 1))
    lines = [
        "# Are the intervals right?",
        "",
        f"Of {posterior['tests']} checks of posteriors on {sum(counts.values())} records "
        f"{posterior['wrong']} fail, of "
        f"{classical['tests']} of refined estimates {classical['wrong']}; a false alarm anywhere in "
        "either has a chance "
        f"of {ALARM:.0%}.",
        "",
        "Each record has its parameters, noise included, drawn from the priors that it is then inferred with "
        f"({run['description'].rstrip('.')}); the ranks of the truth among the draws of NUTS and "
        "emcee are then uniform "
        "(Talts et al. 2018), and so many intervals hold it as they say. By Holm over a table. "
        f"With {fewest} records a "
        f"damping, 95 % intervals of one parameter that are {1 - single:.0%} too narrow in every "
        "record fail a check by "
        f"itself (5 %) with a probability of {POWER:g}, and the whole table where they are {1 - table:.0%} "
        "too narrow.",
        "",
        "| damping | records | tried | share of NUTS's 95 % intervals that hold, least and largest over "
        "parameters |",
        "|---|---|---|---|",
    ]
    for model, count in counts.items():
        own = [
            float(r["value"]) for r in rows
            if r["model"] == model and r["method"] == "nuts" and r["level"] == str(LEVEL)
        ]  # fmt: skip
        shares = f"{min(own):.3f} to {max(own):.3f}" if own else "–"
        lines.append(f"| {model} | {count} | {result['counts'][model]['tried']} | {shares} |")
    lines += [
        "",
        "A record that shows no oscillation is left out before anything is sampled, which a "
        "posterior, being conditional "
        "on its record, does not mind; none is left out for what a sampler says. report.html has the "
        "histograms of the "
        "ranks and the bands, calibration.csv every check, ranks.csv every rank. `make reports` makes it "
        "again, with "
        "`ARGS=--full` from eight times as many records.",
    ]
    return "\n".join(lines) + "\n"


def main(folder: Path) -> None:
    """Write README.md beside a calibration's tables."""
    run = json.loads((folder / "run.json").read_text(encoding="utf-8"))
    with (folder / "calibration.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    (folder / "README.md").write_text(page(run, rows), encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
