"""specimens.csv and population.csv, from a run's cells."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

from bayesdamp.config import Study
from bayesdamp.pipeline.many.populating import log_evidences
from bayesdamp.pipeline.many.specimens import Specimen
from bayesdamp.store import SPECIMEN_TABLES, CellResult, Store, write_table
from bayesdamp.store.contents.many import JointContent, PopulationContent, PopulationFound, Weighing
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


def _head(specimen: Specimen, candidate: str) -> Row:
    damping, law = candidate_parts(candidate)
    law = law or specimen.specs[0].restoring[0]
    return {"specimen": specimen.name, "records": len(specimen.records), "model": damping, "restoring": law}


def _specimens(study: Study, store: Store) -> Iterator[Row]:
    over = PopulationContent.maybe(store.find("population/specimens"))
    for label, specs in study.specimens.items():
        specimen = Specimen(study, label, specs, store)
        cell = store.find(f"joint/{label}")
        joint = JointContent.maybe(cell)
        if cell is not None and joint is not None:
            yield from _joined(specimen, cell, joint)
        elif cell is not None:
            yield {"specimen": label, "records": len(specimen.records), "outcome": cell.outcome}
        elif over is not None and label in over.specimens:
            best, row = over.best, over.specimens[label]
            logs = log_evidences(specimen)
            top = max(logs.values())
            share = math.exp(logs[best] - top) / sum(math.exp(v - top) for v in logs.values())
            common = {"record": specimen.labels[0], "probability": share}
            yield from _rows({**_head(specimen, best), **common}, row, row.units)


def _joined(specimen: Specimen, cell: CellResult, joint: JointContent) -> Iterator[Row]:
    for candidate, row in joint.candidates.items():
        head = {
            **_head(specimen, candidate),
            "shared": joint.sharing,
            "probability": row.probability,
        }
        best = candidate == joint.best
        outcome = cell.outcome if best and cell.outcome != OK else row.outcome
        yield from _rows(head, replace(row, outcome=outcome), row.units)
        if best:
            for record, alone in joint.alone.items():
                units = specimen.units(candidate, list(alone.summary))
                yield from _rows({**_head(specimen, candidate), "record": record}, alone, units)


def _rows(head: Row, row: Weighing, units: Mapping[str, str]) -> Iterator[Row]:
    told = {k: getattr(row, k) for k in WEIGHED}
    common = {**head, **{k: v for k, v in told.items() if v is not None}}
    if not row.summary:
        yield common
    for name, found in row.summary.items():
        yield {**common, "parameter": name, "unit": units[name], **{k: found[k] for k in SUMMARY}}


def _populations(study: Study, store: Store) -> Iterator[Row]:
    for label, specs in study.specimens.items():
        joint = JointContent.maybe(store.find(f"joint/{label}"))
        if joint is not None:
            specimen = Specimen(study, label, specs, store)
            units = joint.candidates[joint.best].units
            for name, found in joint.repeats.items():
                head = {**_head(specimen, joint.best), "over": f"repeats of {label}", "unit": units[name]}
                yield from _population(head, name, found)
    cell = store.find("population/specimens")
    if cell is None:
        return
    content = PopulationContent.maybe(cell)
    if content is None:
        yield {"over": "specimens", "outcome": cell.outcome}
        return
    first, specs = next(iter(study.specimens.items()))
    for name, found in content.populations.items():
        head = {**_head(Specimen(study, first, specs, store), content.best), "over": "specimens"}
        head["unit"] = content.units[name]
        yield from _population(head, name, replace(found, outcome=cell.outcome))


def _population(head: Row, parameter: str, found: PopulationFound) -> Iterator[Row]:
    common = {k: v for k, v in head.items() if k not in ("specimen", "records")}
    common |= {"parameter": parameter, "prior_scale": found.scale, "outcome": found.outcome}
    for what, summary in (("mean", found.mean), ("spread", found.spread)):
        yield {**common, "what": what, **{k: summary[k] for k in SUMMARY}}
    for label, one in found.shrunk.items():
        own = {k: one[k] for k in SUMMARY}
        yield {**common, "what": "own value", "of": label, **own, "effective": found.effective[label]}
