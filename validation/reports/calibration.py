"""Write the page of a calibration or a model recovery: `python -m validation.reports.calibration FOLDER`.

FOLDER contains the results of the run, and gets the page.
"""

import json
import sys
from pathlib import Path
from typing import Any

import pandas as pd

from bayesdamp.calibrate.tables import FALSE_ALARM
from bayesdamp.formatting import markdown_table as table
from validation.scoring import read_rows

LEVEL = 0.95
"""Probability of the intervals whose coverage the page states."""


def calibration(run: dict[str, Any], rows: pd.DataFrame) -> str:
    """Return the page of a calibration in Markdown, from the contents of run.json and the rows of calibration.csv."""
    result = run["result"]
    posterior, classical = (result["families"][name] for name in ("posterior", "classical"))
    lines, total = [], sum(count["counted"] for count in result["counts"].values())
    for model, count in result["counts"].items():
        own = rows.query("model == @model and method == 'nuts' and level == @LEVEL")["value"]
        shares = f"{own.min():.3f} to {own.max():.3f}" if len(own) else "–"
        lines.append([model, str(count["counted"]), str(count["tried"]), shares])
    coverage = "coverage of the 95 % intervals of NUTS, least to largest over parameters"
    return f"""# Are the intervals right?

On {total} records, {posterior["wrong"]} of {posterior["tests"]} checks of posteriors fail, and \
{classical["wrong"]} of {classical["tests"]} checks of refined estimates; the probability of any false alarm is \
{FALSE_ALARM:.0%} for each of the two.

The parameters of each record, including its noise, are drawn from the priors of the inference \
({run["description"].rstrip(".")}). If the inference is correct, the ranks of the truth among the draws of NUTS and \
emcee are uniform (Talts et al. 2018), and intervals contain the truth at their stated rate. The Holm correction \
covers all checks of a table.

{table(["damping", "records", "attempted", coverage], lines)}

A record without an oscillation is omitted before sampling. report.html has the histograms of the ranks with their \
bands, calibration.csv every check, and ranks.csv every rank. `make reports` makes this report again.
"""


def recovery(run: dict[str, Any]) -> str:
    """Return the page of a model recovery in Markdown, from the contents of run.json."""
    result = run["result"]["recovery"]
    hits = result["hits"]
    lines = [
        [
            f"{row['from']:g} to {row['to']:g}", str(row["records"]), f"{row['probability']:.2f}",
            f"{row['share']:.2f}", f"{row['low']:.2f} to {row['high']:.2f}",
        ]
        for row in result["bins"]
    ]  # fmt: skip
    heads = ["highest probability", "records", "mean probability", "fraction right"]
    refused = "; ".join(f"{count} × {why}" for why, count in result["refused"].items()) or "none"
    return f"""# Are the probabilities right?

In {hits["hits"]} of {hits["records"]} records the most probable damping is the true one; the stated probabilities \
predict {hits["expected"]:.1f} ± {hits["sd"]:.1f}.

The true sum of each record is drawn at random from all seven, and its parameters from the priors \
({run["description"].rstrip(".")}). The evidence comes from importance sampling, and the laws are assumed to hold \
exactly. The two-sided p value of this number is {hits["p"]:.2g}. The mean log probability of the truth is \
{result["log_score"]:.3f}; the stated probabilities predict {result["log_score_expected"]:.3f}. *Fraction right* is \
the fraction of the records in a line whose most probable damping is the true one; if the probabilities are right, it \
is in the band.

{table([*heads, f"{1 - FALSE_ALARM:.0%} band for all bins together"], lines)}

{result["tried"]} records were attempted; refused: {refused}. recovery.csv has every record. `make reports` makes \
this report again.
"""


def main(folder: Path) -> None:
    """Write README.md into the folder of a calibration or model recovery, from its run.json and its table."""
    run = json.loads((folder / "run.json").read_text(encoding="utf-8"))
    is_recovery = run["kind"] == "model recovery"
    page = recovery(run) if is_recovery else calibration(run, read_rows(folder / "calibration.csv"))
    (folder / "README.md").write_text(page, encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
