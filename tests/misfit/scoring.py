"""A simulated case through the comparison, and what its verdict says: one row a case, resumable."""

from __future__ import annotations

import csv
import re
import tempfile
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from bayesdamp.config import Study
from bayesdamp.config.compare import Asked, comparison
from bayesdamp.pipeline.jobs import Job, stages, work_of
from bayesdamp.pipeline.tables.tables import write_tables
from bayesdamp.report.results.reading import ranking
from bayesdamp.report.results.run import Run, rows_of
from bayesdamp.report.results.verdict import verdict
from bayesdamp.store import Store
from bayesdamp.types import InputError, candidate_parts
from tests.misfit.cases import Case

COLUMNS = (
    "case", "kind", "truth", "noise_pct", "best", "probability", "damping", "damping_probability", "noise",
    "true_probability", "relation", "warned", "beside", "wrong", "nats_hidden", "rms_pct", "fit", "seconds", "sentence",
)  # fmt: skip
UNREAD = re.compile(r"curve/|sensitivity/.*/(half|savage_dickey)$")
"""Cells that no verdict reads."""
LIMIT = 0.8
"""Probability above which a wrong law needs a warning."""


def score(case: Case, laws: Sequence[str], folder: Path) -> dict[str, object]:
    """The row of one case, compared as `bayesdamp compare` does but without sampling, which no verdict reads."""
    began = time.process_time()
    row: dict[str, object] = {
        "case": case.name, "kind": case.kind, "truth": case.damping,
        "noise_pct": f"{100 * case.noise:.3g}",
    }  # fmt: skip
    file = folder / "record.csv"
    lines = [f"{t!r},{y!r}" for t, y in zip(case.t.tolist(), case.y.tolist(), strict=True)]
    file.write_text("\n".join(["t,angle", *lines]) + "\n", encoding="utf-8")
    try:
        study = comparison([Asked(file, "t", "angle")], restoring=laws)
        study = replace(
            study,
            posterior=study.posterior.model_copy(update={"samplers": (), "best": None}),
            evidence=study.evidence.model_copy(
                update={"methods": ("laplace", "importance"), "referee": "never"}
            ),
        )
        store = Store(folder / "run")
        for stage in stages(study, store):
            for job in stage:
                _compute(study, store, job)
        write_tables(study, store)
    except InputError as error:
        return {**row, "warned": "refused", "wrong": 0, "sentence": str(error).replace(str(folder), "")}
    return {**row, **_read(case, Run(store.folder)), "seconds": f"{time.process_time() - began:.1f}"}


def _compute(study: Study, store: Store, job: Job) -> None:
    """The cells of a job that a verdict depends on."""
    for name, (key, compute) in work_of(study, store, job).items():
        if not UNREAD.match(name):
            compute(name, key)


def _read(case: Case, run: Run) -> dict[str, object]:
    found = ranking(run, "record", 0)
    said = verdict(run, "record", 0)
    if found is None:
        return {"warned": "nothing weighed", "wrong": 0, "sentence": said.sentence}
    shares: Counter[str] = Counter()
    for r in found.rows:
        shares[candidate_parts(r["model"])[0]] += r["probability"]
    damping, share = shares.most_common(1)[0]
    best = found.best["model"]
    fit = next(iter(rows_of(run.fits, model=best)), {})
    return {
        "best": best,
        "probability": f"{found.best['probability']:.4f}",
        "damping": damping,
        "damping_probability": f"{share:.4f}",
        "noise": run.about("record").get("noise", ""),
        "true_probability": f"{shares[case.damping]:.4f}" if case.damping in shares else "",
        "relation": relation(damping, case.damping),
        "warned": "misfit" if said.misfit else "beside" if said.rivals else "open" if said.open else "no",
        "beside": "; ".join(f"{name}: {p:.3f}" for name, p in said.rivals),
        "wrong": int(damping != case.damping and share > LIMIT),
        "nats_hidden": f"{hidden(case, run, best):.1f}",
        "rms_pct": f"{100 * fit.get('rms', np.nan) / case.amplitude:.3g}",
        "fit": fit.get("verdict", ""),
        "sentence": said.sentence,
    }


def relation(found: str, truth: str) -> str:
    """How a damping sum stands to the true one."""
    terms, true = set(found.split("+")), set(truth.split("+"))
    if terms == true:
        return "right"
    if terms < true:
        return "misses a term"
    return "has a term more" if terms > true else "another law"


def hidden(case: Case, run: Run, best: str) -> float:
    """Nats by which the truth, were it known, would be ahead of the best candidate's fit under the true white noise.

    Where this is a few, no test that does not know the truth can see the misfit.
    """
    cell = run.cell("mode", "record", 0, best)
    if cell is None or "fit" not in cell.arrays:
        return np.nan
    start = int(run.about("record").get("start_sample", 0))
    fit = cell.arrays["fit"]
    away = fit - case.clean[start : start + fit.size]
    return float(0.5 * np.sum((away / (case.noise * case.amplitude)) ** 2))


FORMS = {
    "stiction": "friction is larger near rest",
    "cubic": "damping grows faster than with the square of the velocity",
    "root": "damping grows more slowly than with the velocity",
    "damping_changes": "damping changes with time",
}
"""What a kind of case truly is, as a verdict names it where the record leaves it open."""


def names_the_truth(row: Mapping[str, str]) -> bool:
    """Whether a verdict leaves open, first of all other forms of damping, the very one that the record has."""
    return row["warned"] == "beside" and row["beside"].startswith(FORMS.get(row["kind"], "none"))


def unwarned(row: Mapping[str, str]) -> bool:
    """Whether a wrong law has a probability above the limit, and neither a misfit was said nor that the record leaves
    it open: among the candidates, under other priors, or beside another form of damping."""
    return row["warned"] == "no" and row["wrong"] == "1"


def read_rows(table: Path) -> list[dict[str, str]]:
    """The rows of a table, none where there is no file."""
    if not table.is_file():
        return []
    with table.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def scored(
    cases: Iterable[Case], laws: Sequence[str], table: Path, keep: Path | None = None
) -> Iterator[dict[str, object]]:
    """Score the cases that the table lacks, appending each as it is done. keep: where their runs stay."""
    done = {row["case"] for row in read_rows(table)}
    for case in cases:
        if case.name in done:
            continue
        with tempfile.TemporaryDirectory() as temporary:
            folder = keep / case.name if keep else Path(temporary)
            folder.mkdir(parents=True, exist_ok=True)
            row = score(case, laws, folder)
        fresh = not table.is_file()
        with table.open("a", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, COLUMNS, restval="")
            if fresh:
                writer.writeheader()
            writer.writerow(row)
        yield row
