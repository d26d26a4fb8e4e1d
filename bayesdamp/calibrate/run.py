"""`bayesdamp calibrate`: from a study file to its folder."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from rich.console import Console

from bayesdamp.calibrate import probabilities, ranks, recovery, tables
from bayesdamp.calibrate.series import MOST, Series, accepted, gather, is_failed
from bayesdamp.config import Study
from bayesdamp.outcomes import Status, status_of
from bayesdamp.store import CellResult, Store, provenance, write_json, write_table
from bayesdamp.store.contents import RanksContent
from bayesdamp.types import OK

DONE, WRONG_CELLS = 0, 3


def run_calibration(
    study: Study,
    out: Path,
    *,
    records: int | None = None,
    models: bool = False,
    workers: int | None = None,
    fresh: bool = False,
    report: bool = True,
    console: Console | None = None,
) -> int:
    """Compute what `out` does not hold yet, write tables and report; the exit status (0, or 3 with failed chunks).

    records: in place of the study's number; models: whether the models' probabilities are put to the test, else the
    posteriors are. A result of wrong is a result, no failure.
    Raises InputError where the study cannot be calibrated; nothing is written then.
    """
    console = console or Console(stderr=True)
    if records is not None:
        recover = {"records": records, "single": min(study.recovery.single, records)}
        study = replace(
            study,
            calibration=study.calibration.model_copy(update={"records": records}),
            recovery=study.recovery.model_copy(update=recover),
        )
    (recovery if models else ranks).checked(study)
    store = Store(out)
    with store.lock():
        if fresh:
            store.clear()
        found = gather(study, _series(study, models), store, workers, console)
        failed = [c for chunks in found.values() for c in chunks if is_failed(c)]
        whole = {name: [c for c in chunks if c.outcome == OK] for name, chunks in found.items()}
        whole = {name: chunks for name, chunks in whole.items() if chunks}
        if whole:
            (_write_models if models else _write_ranks)(study, store, whole)
            if report:
                from bayesdamp.report import render

                render(out)
        lines = [f"{chunk.name}: {chunk.outcome}" for chunk in failed] + _failures(whole)
        for line in lines:
            console.print(line, style="red", highlight=False)
        for series in _series(study, models):
            good = accepted(whole.get(series.name, ()))
            if good < series.wanted and not failed:
                console.print(
                    f"{series.name}: {good} of {series.wanted} records after trying {MOST} for each"
                )
        return WRONG_CELLS if lines else DONE


def _failures(found: Mapping[str, Sequence[CellResult]]) -> list[str]:
    """Records in which the program failed, a line for each."""
    lines = []
    for chunk in (c for chunks in found.values() for c in chunks):
        content = RanksContent.of(chunk)
        said = [content.outcomes, *content.sampler_outcomes.values()]
        for i in range(len(said[0])):
            lines += [
                f"{chunk.name}, record {i + 1}: {s[i]}" for s in said if status_of(s[i]) is Status.FAILED
            ]
    return lines


def _series(study: Study, models: bool) -> list[Series]:
    if not models:
        compared = study.compare(study.signals[0])
        return [Series("ranks", study.calibration.records, model) for model in compared]
    table = study.recovery
    wanted = {"recovery": table.records, "single": table.single}
    return [Series(kind, count) for kind, count in wanted.items() if count]


def _write_ranks(study: Study, store: Store, found: Mapping[str, Sequence[CellResult]]) -> None:
    rows = tables.calibration_rows(study, found)
    write_table(store.folder / "calibration.csv", tables.COLUMNS, rows)
    write_table(store.folder / "ranks.csv", tables.RANK_COLUMNS, tables.rank_rows(study, found))
    _write_info(study, store, "calibration", tables.about(study, found, rows))


def _write_models(study: Study, store: Store, found: Mapping[str, Sequence[CellResult]]) -> None:
    columns, rows = probabilities.record_table(found)
    write_table(store.folder / "recovery.csv", columns, rows)
    _write_info(study, store, "model recovery", probabilities.about(found))


def _write_info(study: Study, store: Store, kind: str, result: Mapping[str, Any]) -> None:
    about = {"name": study.name, "description": study.description, "seed": study.seed, "kind": kind}
    write_json(
        store.folder / "run.json", {**about, "study": study.resolved(), **provenance(), "result": result}
    )
