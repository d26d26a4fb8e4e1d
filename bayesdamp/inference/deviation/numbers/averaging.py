"""How far averaged motions are from the equation of motion itself, in what a record tells."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bayesdamp.inference.deviation.averaged import Averaging
from bayesdamp.inference.deviation.candidate import refit
from bayesdamp.inference.deviation.numbers.bounds import columns_of
from bayesdamp.inference.deviation.numbers.curves import values_of
from bayesdamp.inference.deviation.weighing import START, Result, Weighing, result_of
from bayesdamp.machine.threads import at_once
from bayesdamp.physics.kernel.averaged import AveragedSolver

NEAR = 10.0
"""Nats behind the best up to which a candidate counts."""


def set_right(weighing: Weighing, approximate: bool) -> Weighing:
    """With the candidates that count set right by the ODE at their own modes, deviations included."""
    best = max(r.log_evidence for r in weighing.results)

    def right(r: Result) -> Result:
        if best - r.log_evidence > NEAR:
            return r
        assert isinstance(r.solver, AveragedSolver)
        solver = r.solver.corrected(values_of(r), r.fit.active, *r.deviations)
        if solver is None:
            return r
        data = weighing.data
        found, noise = refit(solver, data, r.fit), (weighing.variance, weighing.inflation)
        if found is None:
            return r
        return result_of(r.candidate, solver, found, data, noise, approximate, weighing.noise_known)

    results = tuple(at_once(right, weighing.results))
    top = max(results, key=lambda r: r.log_evidence)
    solvers = {**weighing.solvers, top.candidate.restoring: top.solver}
    return replace(weighing, results=results, solvers=solvers)


def averaging_of(weighing: Weighing) -> Averaging | None:
    """How far a weighing is from one by the ODE; None where it is by the ODE."""
    if weighing.data.averaged is None or not weighing.results:
        return None
    result = max(weighing.results, key=lambda r: r.log_evidence)
    solver = result.solver
    assert isinstance(solver, AveragedSolver)
    off = solver.error(values_of(result), result.fit.active, *result.deviations)
    base = columns_of(weighing, result, result.about is not None)
    if off is None or base is None:
        return Averaging(weighing.data.cycles, float("inf"))
    weighed = result.exact_weighed if result.weighed is None else result.weighed
    variance = result.exact_variance if result.weighed is None else weighing.variance
    moved, spread = np.zeros(weighed.means.shape[1]), np.zeros(weighed.means.shape[1])
    # Over the hyperparameters: what one set of them holds firmly another leaves free.
    for weight, factor in zip(weighed.weights, weighed.factors, strict=True):
        shift, sd = factor @ (factor.T @ (base[0].T @ off)) / variance, np.linalg.norm(factor, axis=1)
        moved, spread = moved + weight * shift, spread + weight * sd**2
    names = result.fit.parameters.free_names
    told = [i for i, name in enumerate(names) if name not in START]
    error = float(np.max(np.abs(moved[told]) / np.sqrt(spread[told]), initial=0.0))
    return Averaging(weighing.data.cycles, error)
