"""specimens.csv and population.csv, from a run's cells."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from bayesdamp.config import Study
from bayesdamp.inference.curves.weighted import summarise
from bayesdamp.pipeline.many.joining import coefficients_of
from bayesdamp.pipeline.many.specimens import Specimen
from bayesdamp.store import SPECIMEN_TABLES, Store, write_table
from bayesdamp.store.contents import JointContent, PopulationContent, PopulationFound, Summary, Weighing
from bayesdamp.types import OK, candidate_parts

Row = dict[str, Any]
SUMMARY = ("mean", "sd", "median", "q2.5", "q97.5")


def write_specimen_tables(study: Study, store: Store) -> None:
    """Both tables, where the study names specimens."""
    if not study.specimens:
        return
    for (name, columns), rows_of in zip(SPECIMEN_TABLES.items(), (_specimens, _populations), strict=True):
        write_table(store.folder / name, columns, rows_of(study, store))


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
        if joint is not None:
            yield from _joined(specimen, joint)
        elif cell is not None:
            yield {"specimen": label, "records": len(specimen.records), "outcome": cell.outcome}
        elif over is not None and label in over.specimens:
            row = over.specimens[label]
            head = {**_head(specimen, over.best), "record": specimen.labels[0]}
            yield from _rows({**head, "probability": row.probability}, row)


def _joined(specimen: Specimen, joint: JointContent) -> Iterator[Row]:
    for candidate, row in joint.candidates.items():
        head = {**_head(specimen, candidate), "shared": "damping", "probability": row.probability}
        yield from _rows(head, row)
        if candidate == joint.best:
            for record, alone in joint.alone.items():
                yield from _rows({**_head(specimen, candidate), "record": record}, alone)


def _rows(head: Row, row: Weighing) -> Iterator[Row]:
    common = {**head, "outcome": row.outcome}
    if row.log_evidence is not None:
        common["log_evidence"] = row.log_evidence
    if not row.summary:
        yield common
    for name, found in row.summary.items():
        yield {**common, "parameter": name, "unit": row.units[name], **_numbers(found)}


def _numbers(summary: Summary) -> Row:
    return {k: summary[k] for k in SUMMARY}


def _populations(study: Study, store: Store) -> Iterator[Row]:
    for label, specs in study.specimens.items():
        cell = store.find(f"joint/{label}")
        joint = JointContent.maybe(cell)
        if cell is not None and joint is not None:
            yield from _of_repeats(Specimen(study, label, specs, store), cell.arrays, joint)
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


def _of_repeats(specimen: Specimen, arrays: Mapping[str, np.ndarray], joint: JointContent) -> Iterator[Row]:
    """The specimen's coefficients, by how much they vary from record to record, and those of each record alone."""
    head = {k: v for k, v in _head(specimen, joint.best).items() if k not in ("specimen", "records")}
    row = joint.candidates[joint.best]
    for name, draws in coefficients_of(arrays, joint.best).items():
        spread = summarise(draws * arrays[f"{joint.best}/spread"], np.full(draws.size, 1 / draws.size))
        common = {
            **head, "over": f"repeats of {specimen.name}", "parameter": name, "unit": row.units[name], "outcome": OK,
        }  # fmt: skip
        yield {**common, "what": "mean", **_numbers(row.summary[name])}
        yield {**common, "what": "spread", **_numbers(spread)}
        for label, alone in joint.alone.items():
            yield {**common, "what": "own value", "of": label, **_numbers(alone.summary[name])}


def _population(head: Row, parameter: str, found: PopulationFound) -> Iterator[Row]:
    common = {k: v for k, v in head.items() if k not in ("specimen", "records")}
    common |= {"parameter": parameter, "prior_scale": found.scale, "outcome": found.outcome}
    for what, summary in (("mean", found.mean), ("spread", found.spread)):
        yield {**common, "what": what, **_numbers(summary)}
    for label, one in found.shrunk.items():
        own = {**_numbers(one), "effective": found.effective[label]}
        yield {**common, "what": "own value", "of": label, **own}
