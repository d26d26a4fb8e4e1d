"""verdict.json, verdicts.csv and damping_curves.csv, from a run's cells."""

from __future__ import annotations

from collections.abc import Sequence

from bayesdamp.config import SignalSpec, Study
from bayesdamp.pipeline.records.answering import answer_of, answered_of, stated_priors, verdict_of
from bayesdamp.pipeline.records.records import cell_seed
from bayesdamp.store import DAMPING_CURVES, Store, write_table
from bayesdamp.units import Unit, unit_named
from bayesdamp.verdict import files
from bayesdamp.verdict.specimen import specimen
from bayesdamp.verdict.types import Verdict
from bayesdamp.verdict.units import in_unit, picture_in_unit


def write_verdicts(study: Study, store: Store) -> None:
    """The files, an object, a line and a curve for each record that has a verdict; none where no record has one.

    verdict.json is in rad, m or the sensor's unit; lines have the unit that a record came in, and say it.
    """
    found: list[tuple[Verdict, Unit]] = []
    for spec, repeat in study.records:
        verdict = verdict_of(store, spec.name, repeat)
        if verdict is not None:
            found.append((verdict, unit_of(spec)))
    for name, specs in study.every_specimen.items():
        together = _specimen(study, store, name, specs)
        if together is not None:
            own = {unit_of(spec) for spec in specs}
            found.append((together, own.pop() if len(own) == 1 else unit_named(unit_of(specs[0]).base)))
    if not found:
        return
    files.write(store.folder, [v for v, _ in found], [in_unit(v, unit) for v, unit in found])
    curves = [row for spec, repeat in study.records for row in _curve(store, spec, repeat)]
    write_table(store.folder / "damping_curves.csv", ("record", "unit", *DAMPING_CURVES), curves)


def _specimen(study: Study, store: Store, name: str, specs: Sequence[SignalSpec]) -> Verdict | None:
    """Return the verdict on a specimen; None where fewer than two of its records have an answer."""
    if sum(spec.repeats for spec in specs) < 2:
        return None
    if specs[0].is_envelope:
        from bayesdamp.interface.envelopes import specimen_of_envelopes  # imports slowly

        found = (answer_of(store, spec.name, 0) for spec in specs)
        return specimen_of_envelopes(name, [a for a in found if a is not None])
    every = (answered_of(store, spec.name, repeat) for spec in specs for repeat in range(spec.repeats))
    answered = [a for a in every if a is not None]
    seed = cell_seed(study, f"specimen/{name}")
    given = stated_priors(study), study.posterior.sensor, seed
    return specimen(name, answered, *given) if len(answered) > 1 else None


def _curve(store: Store, spec: SignalSpec, repeat: int) -> list[dict[str, object]]:
    """A record's damping curve without a law, a line an amplitude."""
    answer = answer_of(store, spec.name, repeat)
    if answer is None or "free/amplitude" not in answer.arrays:
        return []
    unit = unit_of(spec)
    arrays = picture_in_unit(answer.arrays, unit)
    columns = [arrays[f"free/{name}"].tolist() for name in DAMPING_CURVES]
    return [
        {
            "record": answer.verdict.record,
            "unit": unit.displacement.name,
            **dict(zip(DAMPING_CURVES, row, strict=True)),
        }
        for row in zip(*columns, strict=True)
    ]


def unit_of(spec: SignalSpec) -> Unit:
    """The unit that a signal's record came in."""
    return unit_named(spec.source.unit)
