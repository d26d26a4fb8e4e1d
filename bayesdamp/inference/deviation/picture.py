"""What the picture of an answer is drawn from: the record with its fit, damping against amplitude, energy by term."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from bayesdamp.inference.deviation.findings import Findings
from bayesdamp.inference.deviation.numbers.curves import further_of, orbit_of, works_on
from bayesdamp.inference.deviation.weighing import Weighing

POINTS = 3000
"""Samples of a record that are kept for a picture, thinned to the extremes of each stretch."""


def picture(weighing: Weighing, found: Findings) -> Mapping[str, np.ndarray]:
    """Arrays by name: t, record, fit, residual (thinned, (p,); amplitudes, where the record was taken as such);
    amplitude, ratio, low, high (a,) of the answer; free/* the curve without a law and the energy lost in a cycle under
    it; law/SUM the ratio of each sum's own fit under exact laws; work/TERM the energy lost in a cycle by each term, per
    unit of inertia."""
    data = weighing.data
    best = next(r for r in weighing.results if r.candidate == found.best)
    motion = best.motion
    t, y, fitted = (data.of_amplitude(values) for values in (data.times, data.recorded, motion.y))
    kept = _kept(y)
    curve = found.curve
    amplitude = np.array([r.amplitude for r in curve])
    arrays: dict[str, np.ndarray] = {
        "t": t[kept],
        "record": y[kept],
        "fit": fitted[kept],
        "residual": (y - fitted)[kept],
        "amplitude": amplitude,
        "ratio": np.array([r.value for r in curve]),
        "low": np.array([r.low for r in curve]),
        "high": np.array([r.high for r in curve]),
    }
    if found.exponents:
        arrays["exponent"] = np.array(found.exponents)
    if found.free is not None:
        arrays["free/amplitude"] = found.free.amplitude
        for name, values in (("ratio", found.free.ratio), ("lost", found.free.lost)):
            for end, column in zip(("", "_low", "_high"), values.T, strict=True):
                arrays[f"free/{name}{end}"] = column
    terms = next(iter(weighing.solvers.values())).terms
    for r in weighing.results:
        if r.candidate.restoring != found.best.restoring:
            continue
        values = r.fit.parameters.values(r.fit.z)
        coefficients = values[: len(terms)]
        solver = weighing.solvers[r.candidate.restoring]
        further = further_of(r, values)
        orbits = [orbit_of(weighing, best, float(a)) for a in amplitude]
        none = np.full(len(terms), np.nan)
        work = coefficients * np.array([
            none if o is None else works_on(o, solver, further, r.fit.active)[0] for o in orbits
        ])  # fmt: skip
        energy = np.array([np.nan if o is None else o.energy for o in orbits])
        arrays[f"law/{'+'.join(r.candidate.damping)}"] = work.sum(axis=1) / (4 * np.pi * energy)
        if r is best:
            arrays |= {f"work/{t}": work[:, i] for i, t in enumerate(terms) if t in r.candidate.damping}
    return arrays


def _kept(y: np.ndarray) -> np.ndarray:
    size = -(-y.size // (POINTS // 2))
    if size <= 2:
        return np.arange(y.size)
    found = {0, y.size - 1}
    for i in range(0, y.size, size):
        block = y[i : i + size]
        found |= {i + int(block.argmin()), i + int(block.argmax())}
    return np.array(sorted(found))
