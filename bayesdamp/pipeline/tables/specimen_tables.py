"""specimens.csv and population.csv, from a run's cells."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from bayesdamp.config import Study
from bayesdamp.pipeline.many.populating import log_evidences
from bayesdamp.pipeline.many.specimens import Specimen
from bayesdamp.store import SPECIMEN_TABLES, CellResult, Store, write_table
from bayesdamp.types import OK, candidate_parts

Row = dict[str, Any]
SUMMARY = ("mean", "sd", "median", "q2.5", "q97.5")
WEIGHED = ("log_evidence", "stderr", "pareto_k", "effective", "outcome")


def write_specimen_tables(study: Study, store: Store) -> None:
    """Both tables, where the study names specimens."""
    if not study.specimens:
        return
    for name, rows in (
        ("specimens.csv", _specimens(study, store)),
        ("population.csv", _populations(study, store)),
    ):
        write_table(store.folder / name, SPECIMEN_TABLES[name], rows)


def _read(store: Store, name: str) -> CellResult | None:
    try:
        return store.read(name)
    except KeyError:
        return None


def _head(specimen: Specimen, candidate: str) -> Row:
    damping, law = candidate_parts(candidate)
    law = law or specimen.specs[0].restoring[0]
    return {"specimen": specimen.name, "records": len(specimen.records), "model": damping, "restoring": law}


def _specimens(study: Study, store: Store) -> Iterator[Row]:
    over = _read(store, "population/specimens")
    for label, specs in study.specimens.items():
        specimen = Specimen(study, label, specs, store)
        cell = _read(store, f"joint/{label}")
        if cell is not None and "candidates" in cell.meta:
            yield from _joined(specimen, cell)
        elif cell is not None:
            yield {"specimen": label, "records": len(specimen.records), "outcome": cell.outcome}
        elif over is not None and label in over.meta.get("specimens", {}):
            best = over.meta["best"]
            row = over.meta["specimens"][label]
            logs = log_evidences(specimen)
            top = max(logs.values())
            share = math.exp(logs[best] - top) / sum(math.exp(v - top) for v in logs.values())
            common = {"record": specimen.labels[0], "probability": share}
            yield from _rows({**_head(specimen, best), **common}, row, row["units"])


def _joined(specimen: Specimen, cell: CellResult) -> Iterator[Row]:
    for candidate, row in cell.meta["candidates"].items():
        head = {
            **_head(specimen, candidate),
            "shared": cell.meta["sharing"],
            "probability": row["probability"],
        }
        best = candidate == cell.meta["best"]
        outcome = cell.outcome if best and cell.outcome != OK else row["outcome"]
        yield from _rows(head, {**row, "outcome": outcome}, row.get("units", {}))
        if best:
            for record, alone in cell.meta["alone"].items():
                units = specimen.units(candidate, list(alone["summary"]))
                yield from _rows({**_head(specimen, candidate), "record": record}, alone, units)


def _rows(head: Row, row: Mapping[str, Any], units: Mapping[str, str]) -> Iterator[Row]:
    common = {**head, **{k: row[k] for k in WEIGHED if k in row}}
    summary = row.get("summary", {})
    if not summary:
        yield common
    for name, found in summary.items():
        yield {**common, "parameter": name, "unit": units[name], **{k: found[k] for k in SUMMARY}}


def _populations(study: Study, store: Store) -> Iterator[Row]:
    for label, specs in study.specimens.items():
        cell = _read(store, f"joint/{label}")
        if cell is not None and "repeats" in cell.meta:
            specimen = Specimen(study, label, specs, store)
            best = cell.meta["best"]
            units = cell.meta["candidates"][best]["units"]
            for name, found in cell.meta["repeats"].items():
                head = {**_head(specimen, best), "over": f"repeats of {label}", "unit": units[name]}
                yield from _population(head, name, found)
    cell = _read(store, "population/specimens")
    if cell is None:
        return
    if "populations" not in cell.meta:
        yield {"over": "specimens", "outcome": cell.outcome}
        return
    best = cell.meta["best"]
    first, specs = next(iter(study.specimens.items()))
    for name, found in cell.meta["populations"].items():
        head = {**_head(Specimen(study, first, specs, store), best), "over": "specimens"}
        outcome = cell.outcome
        yield from _population(
            {**head, "unit": cell.meta["units"][name]}, name, {**found, "outcome": outcome}
        )


def _population(head: Row, parameter: str, found: Mapping[str, Any]) -> Iterator[Row]:
    common = {k: v for k, v in head.items() if k not in ("specimen", "records")}
    common |= {"parameter": parameter, "prior_scale": found["scale"], "outcome": found["outcome"]}
    for what in ("mean", "spread"):
        yield {**common, "what": what, **{k: found[what][k] for k in SUMMARY}}
    for label, one in found["shrunk"].items():
        own = {k: one[k] for k in SUMMARY}
        yield {**common, "what": "own value", "of": label, **own, "effective": found["effective"][label]}
