"""The arrays that the picture of an answer is drawn from."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from bayesdamp.inference.deviation.findings import Findings
from bayesdamp.inference.deviation.numbers.curves import orbit_of, works_on
from bayesdamp.inference.deviation.weighing import Weighing

POINTS = 3000
"""Samples of a record that a picture shows, thinned to the extremes of each stretch."""


def picture(weighing: Weighing, numbers: Findings) -> Mapping[str, np.ndarray]:
    """Return the arrays of a picture by name.

    t, record, fit, residual: thinned, (p,); amplitudes, where the record is taken as such. amplitude, ratio, low, high:
    of the answer, (a,). free/*: the curve without a law and the energy lost in a cycle under it. law/SUM: the ratio of
    each sum's own fit under exact laws. work/TERM: the energy lost in a cycle by each term, per unit of inertia.
    """
    data = weighing.data
    best = weighing.result(numbers.best)
    t, y, fitted = (data.of_amplitude(values) for values in (data.times, data.recorded, best.motion.y))
    rows = _extremes(y)
    curve = numbers.curve
    amplitude = np.array([r.amplitude for r in curve])
    arrays: dict[str, np.ndarray] = {
        "t": t[rows],
        "record": y[rows],
        "fit": fitted[rows],
        "residual": (y - fitted)[rows],
        "amplitude": amplitude,
        "ratio": np.array([r.value for r in curve]),
        "low": np.array([r.low for r in curve]),
        "high": np.array([r.high for r in curve]),
    }
    if numbers.exponents:
        arrays["exponent"] = np.array(numbers.exponents)
    if numbers.free is not None:
        arrays["free/amplitude"] = numbers.free.amplitude
        for name, values in (("ratio", numbers.free.ratio), ("lost", numbers.free.lost)):
            for end, column in zip(("", "_low", "_high"), values.T, strict=True):
                arrays[f"free/{name}{end}"] = column
    terms, solver = weighing.terms, weighing.solvers[numbers.best.restoring]
    orbits = [orbit_of(best, float(a)) for a in amplitude]
    energy = np.array([np.nan if o is None else o.energy for o in orbits])
    none = np.full(len(terms), np.nan)
    for r in weighing.results:
        if r.candidate.restoring != numbers.best.restoring:
            continue
        values = r.fit.values
        further = values[None, len(terms) : solver.law_places.start]
        works = [none if o is None else works_on(o, solver, further, r.fit.active)[0] for o in orbits]
        work = values[: len(terms)] * np.array(works)
        arrays[f"law/{'+'.join(r.candidate.damping)}"] = work.sum(axis=1) / (4 * np.pi * energy)
        if r is best:
            arrays |= {f"work/{t}": work[:, i] for i, t in enumerate(terms) if t in r.candidate.damping}
    return arrays


def _extremes(y: np.ndarray) -> np.ndarray:
    """Return the places of the least and the largest value in each stretch, and of the ends."""
    size = -(-y.size // (POINTS // 2))
    if size <= 2:
        return np.arange(y.size)
    places = {0, y.size - 1}
    for i in range(0, y.size, size):
        block = y[i : i + size]
        places |= {i + int(block.argmin()), i + int(block.argmax())}
    return np.array(sorted(places))
