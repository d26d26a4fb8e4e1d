"""How far averaged motions are from the equation of motion itself, in what a record tells."""

from __future__ import annotations

import numpy as np

from bayesdamp.inference.deviation.averaged import Averaging
from bayesdamp.inference.deviation.numbers.bounds import columns_of
from bayesdamp.inference.deviation.numbers.curves import values_of
from bayesdamp.inference.deviation.weighing import Weighing
from bayesdamp.physics.kernel.averaged import TURNS, AveragedSolver

START = ("theta0", "omega0")


def averaging_of(weighing: Weighing) -> Averaging | None:
    """How far a weighing is from one by the ODE; None where it is by the ODE."""
    averaged = weighing.data.averaged
    if averaged is None or not weighing.results:
        return None
    solved = TURNS * averaged.track.sizes.size
    result = max(weighing.results, key=lambda r: r.log_evidence)
    solver, about, d = result.solver, result.about, result.fit.z.size
    assert isinstance(solver, AveragedSolver)
    g = h = None
    if about is not None:
        g, h = np.split(about.u[d:], 2)
        g = np.expm1(g)
    off = solver.error(values_of(result), result.fit.active, g, h)
    base = columns_of(weighing, result, about is not None)
    if off is None or base is None:
        return Averaging(weighing.data.cycles, solved, float("inf"), float("inf"))
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
    return Averaging(weighing.data.cycles, solved, float(np.sqrt(np.mean(off**2) / variance)), error)
