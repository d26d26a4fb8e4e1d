"""Compare the measured decays: `python -m tests.measured.run FOLDER [NAME ...]`.

Each record goes through what `bayesdamp compare` does, with no options but its columns and unit. Runs are kept in
FOLDER, one folder a record, and resumed; `table.csv` there has a row for each that is done.
"""

from __future__ import annotations

import sys
from pathlib import Path

from rich.console import Console

from bayesdamp.config.compare import Asked, comparison
from bayesdamp.report.reading import ranking, summary_rows
from bayesdamp.report.run import Run, rows_of
from bayesdamp.report.verdict import verdict
from bayesdamp.store import write_table
from bayesdamp.study import run_study
from bayesdamp.study.workers import cache_compilations
from tests.measured.records import RECORDS

COLUMNS = (
    *("record", "damping", "restoring", "probability", "noise", "coefficients", "rms", "rms_unit", "share"),
    *("window_spread", "fit", "misfit", "verdict", "seconds"),
)


def row(name: str, folder: Path) -> dict[str, object]:
    """What a finished run says of its record."""
    run = Run(folder)
    signal = run.signals[0]
    found = ranking(run, signal, 0)
    said = verdict(run, signal, 0)
    line: dict[str, object] = {"record": name, "misfit": said.misfit, "verdict": said.sentence}
    line["seconds"] = round(sum(run.info["seconds"].values()))
    if found is None:
        return line
    model = found.best["model"]
    fit = rows_of(run.fits, signal=signal, repeat=0, model=model)[0]
    sizes = [
        f"{r['parameter']} {r['mean']:.4g} ± {r['sd']:.2g} {r['unit']}"
        for r in summary_rows(run, signal, 0, model)[1]
        if r["parameter"] in ("zeta", "mu_c", "mu_q")
    ]
    noise = run.cell("noise", signal, 0)
    line |= {k: fit[k] for k in ("rms", "rms_unit", "window_spread")}
    line |= {
        "damping": model.partition("@")[0],
        "restoring": found.best["restoring"],
        "probability": round(found.best["probability"], 4),
        "noise": noise.meta.get("chosen", "") if noise else "",
        "coefficients": "; ".join(sizes),
        "fit": fit["verdict"],
    }
    return line


def main(folder: Path, wanted: list[str]) -> None:
    cache_compilations()
    rows = []
    for record in RECORDS:
        own = folder / record.name
        if not wanted or record.name in wanted:
            made = comparison([Asked(record.path, **record.options)])
            run_study(made, own, workers=1, console=Console(stderr=True))
        if (own / "run.json").exists():
            rows.append(row(record.name, own))
            print(rows[-1], flush=True)
    write_table(folder / "table.csv", COLUMNS, [{c: r.get(c, "") for c in COLUMNS} for r in rows])


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:])
