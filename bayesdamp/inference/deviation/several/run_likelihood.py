"""What one run says of its damping alone: the part of a candidate that several runs of a specimen are joined from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bayesdamp.inference.deviation.gaussian.repeats import RunLikelihood
from bayesdamp.inference.deviation.numbers.curves import orbit_of, values_of, works_on
from bayesdamp.inference.deviation.weighing import Result, Weighing
from bayesdamp.physics.damping import TERMS

STEP = 1e-4
"""Relative change of a term's own parameter over which the slope of its loss is taken."""


@dataclass(frozen=True)
class DampingRun(RunLikelihood):
    """A candidate on one run: the likelihood of its damping, and what damping ratio that is.

    per_unit: equivalent damping ratio per unit of each of the likelihood's parameters at the amplitudes of the run's
    curve, (a, k), 0 for those that are no coefficients; growth: by how much the logarithm of the whole ratio grows with
    each parameter beside the coefficients, per unit, (a, k).
    """

    per_unit: np.ndarray
    growth: np.ndarray

    def ratio(self, row: int, draws: np.ndarray) -> np.ndarray:
        """Damping ratios at one of the amplitudes, of parameters (n, k): (n,)."""
        along = (draws - self.mode) @ self.growth[row]
        return (draws @ self.per_unit[row]) * np.exp(along)


def damping_run(
    weighing: Weighing, result: Result, amplitudes: np.ndarray, approximate: bool
) -> DampingRun | None:
    """A candidate's likelihood of its damping. None where it was not weighed with the deviations asked for.

    amplitudes: of the run's curve, rad or m, (a,).
    """
    weighed = result.weighed if approximate else result.exact_weighed
    if weighed is None or weighed.damping is None:
        return None
    parameters, solver = result.fit.parameters, result.solver
    z = result.fit.z if result.about is None or not approximate else result.about.u[: result.fit.z.size]
    places = np.flatnonzero(parameters.damping)
    names = [parameters.free_names[i] for i in places]
    coefficients = [TERMS.get(t).parameter for t in result.candidate.damping]
    found = RunLikelihood.of_scores(
        {n: parameters.priors[n] for n in names}, coefficients, z[places], weighed.damping
    ).shifted(result.log_evidence - weighed.log_evidence if result.sampled is not None else 0.0)
    values, m = values_of(result), len(solver.terms)
    per_unit, growth = np.zeros((amplitudes.size, len(names))), np.zeros((amplitudes.size, len(names)))
    place = {n: i for i, n in enumerate(names)}
    for row, amplitude in enumerate(amplitudes):
        orbit = orbit_of(weighing, result, float(amplitude))
        if orbit is None:
            per_unit[row] = np.nan
            continue
        further = values[m : solver.law_places.start]
        each = works_on(orbit, solver, further[None], result.fit.active)[0] / (4 * np.pi * orbit.energy)
        for name, value in zip(solver.names[:m], each, strict=True):
            if name in place:
                per_unit[row, place[name]] = value
        whole = float(each @ values[:m])
        for i, name in enumerate(solver.further):
            if name in place and whole > 0:
                step = STEP * max(abs(further[i]), 1e-3)
                moved = further.copy()
                moved[i] += step
                changed = works_on(orbit, solver, moved[None], result.fit.active)[0] / (
                    4 * np.pi * orbit.energy
                )
                growth[row, place[name]] = float(np.log((changed @ values[:m]) / whole)) / step
    return DampingRun(**vars(found), per_unit=per_unit, growth=growth)
