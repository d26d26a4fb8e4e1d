"""What no named law explains, and what a record does not tell."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from bayesdamp.inference.deviation.numbers.curves import (
    at_share,
    orbit_of,
    ratios_per_unit,
    share_of_time,
)
from bayesdamp.inference.deviation.numbers.draws import Drawn, Quantity, quantity
from bayesdamp.inference.deviation.weighing import Weighing
from bayesdamp.physics.kernel import Solver
from bayesdamp.priors import Prior

FEW = 400
"""Draws, of all candidates together."""
AS_WIDE = 0.7
"""Width of an interval, in the prior's own, from which the record does not tell a parameter (conventional)."""
TIED, LOOSE = 0.98, 0.2
"""Correlation from which two parameters cannot be told apart where both have a half interval of this share and more
(conventional)."""


def unnamed_share(weighing: Weighing, drawn: Sequence[Drawn], amplitudes: Sequence[float]) -> Quantity | None:
    """Share of the energy that no sum of the terms compared explains: of each draw's own curve, deviation included,
    what is off the nearest sum with coefficients that are not negative, weighted by the energy lost. amplitudes, at
    which it is taken, fall."""
    total = sum(len(d.coefficients) for d in drawn)
    found = [
        part
        for d in drawn
        for part in _off(weighing, d, amplitudes, max(1, round(FEW * len(d.coefficients) / total)))
    ]
    return quantity(np.array(found)) if found else None


def _off(weighing: Weighing, d: Drawn, amplitudes: Sequence[float], count: int) -> list[float]:
    from scipy.optimize import nnls

    every = np.unique(np.linspace(0, len(d.coefficients) - 1, count).astype(int))
    few = Drawn(d.result, *(a[every] for a in (d.coefficients, d.further, d.law, d.g, d.h)))
    unit, curve, energy = [], [], []
    for a in amplitudes:
        per_unit, orbit = (
            ratios_per_unit(weighing, few, a, every_term=True),
            orbit_of(weighing, d.result, a),
        )
        if per_unit is None or orbit is None:
            return []
        share = share_of_time(weighing, d.result, a)
        own = np.sum(few.coefficients * per_unit, axis=1)
        unit.append(np.broadcast_to(per_unit, few.coefficients.shape))
        curve.append(own * np.exp(at_share(few.g, share)) / (1 + at_share(few.h, share)))
        energy.append(orbit.energy)
    weight = np.abs(np.gradient(np.array(energy)))
    weight /= weight.sum()
    found = []
    for i in range(len(every)):
        ratio = np.array([c[i] for c in curve])
        if not np.all(ratio > 0):  # no loss, no share of it
            continue
        columns = np.array([u[i] for u in unit]) / ratio[:, None]
        scale = np.maximum(np.abs(columns).max(axis=0), 1e-300)
        fitted = nnls(np.sqrt(weight)[:, None] * columns / scale, np.sqrt(weight))[0]
        found.append(float(weight @ np.abs(1 - columns / scale @ fitted)))
    return found


def untold(d: Drawn, solver: Solver) -> tuple[str, ...]:
    """Names of the terms' further parameters whose interval is as wide as what was assumed of them beforehand."""
    priors, found = d.result.fit.parameters.priors, []
    for i, name in enumerate(solver.further):
        if name in solver.inferred and name in priors:
            low, high = np.quantile(d.further[:, i], (0.025, 0.975))
            if as_wide(priors[name], float(low), float(high)):
                found.append(name)
    return tuple(found)


def as_wide(prior: Prior, low: float, high: float) -> bool:
    """Whether an interval is nearly as wide as the prior's own, in the prior's scores."""
    whole = 2.24 - 0.03 if prior.reflected else 2 * 1.96
    return float(prior.score(high) - prior.score(low)) > AS_WIDE * whole


def tied(d: Drawn, solver: Solver) -> tuple[tuple[str, str], ...]:
    """Pairs of a candidate's coefficients and further parameters that the record tells only together."""
    names = (*solver.names[: len(solver.terms)], *solver.further)
    values = np.column_stack([d.coefficients, d.further])
    free = [
        i for i, name in enumerate(names) if name in d.result.fit.parameters.priors and values[:, i].std() > 0
    ]
    found = []
    for i, j in combinations(free, 2):
        loose = all(1.96 * values[:, k].std() > LOOSE * abs(values[:, k].mean()) for k in (i, j))
        if loose and abs(np.corrcoef(values[:, i], values[:, j])[0, 1]) > TIED:
            found.append((names[i], names[j]))
    return tuple(found)
