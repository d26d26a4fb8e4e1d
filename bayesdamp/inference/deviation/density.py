"""The density of a candidate's parameters, the deviations of its laws integrated out, about its mode."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from bayesdamp.inference.deviation.candidate import columns_at
from bayesdamp.inference.deviation.gaussian.hyperparameters import grid_of
from bayesdamp.inference.deviation.least_squares import SEARCHED
from bayesdamp.inference.deviation.sampled.motions import Motions, motions_near
from bayesdamp.inference.deviation.weighing import Result, Weighing
from bayesdamp.inference.fit.mode import LinearPosterior, Mode
from bayesdamp.inference.model.deviation import Deviation
from bayesdamp.inference.model.likelihood import Likelihood
from bayesdamp.inference.model.target import Target
from bayesdamp.physics.kernel import Motion, Solver
from bayesdamp.physics.kernel.solve import TOLERANCE
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.physics.trajectories import Trajectories
from bayesdamp.types import Refusal, Signal

ESCAPED = "no motion near the fit can be followed with deviations from its law"
NEGLIGIBLE = 1e-8
"""Posterior probability under the linear model from which a combination of hyperparameters is left out."""


class Deviating(Trajectories):
    """Motions with deviations held, as means over windows, or as amplitudes and phases, where the data are these.

    Parameters
    ----------
    motions : Motions
        Of draws, with their tolerance and what motions of it lack.
    g, h : ndarray, shape (n,)
        Relative deviations of damping and frequency at the knots.
    given : mapping of str to float
        Values of the kernel's parameters that are not inferred.
    """

    def __init__(self, motions: Motions, g: np.ndarray, h: np.ndarray, given: Mapping[str, float]) -> None:
        self._solver, self._motions, self._deviations = motions.solver, motions, (g, h)  # type: ignore[assignment]
        self._given = {**dict.fromkeys(motions.solver.names, 0.0), **given}
        self._rests, self._count = False, motions.solver.t.size

    def _solved(
        self, p: Mapping[str, float], epsilon: float, tangents: int, solver: Solver | None = None
    ) -> Motion | None:
        vector = np.array([float(p.get(name, self._given[name])) for name in self._solver.names])
        of, tolerance = self._motions, SEARCHED if tangents else self._motions.tolerance
        found = of.solver.solve(vector, of.active, *self._deviations, tangents, tolerance=tolerance)
        return found if found is None or tangents else replace(found, y=found.y + of.correction)


def density_of(weighing: Weighing, result: Result, draws: np.ndarray, known: Mapping[str, float]) -> Mode:
    """Return the density of a weighed candidate's parameters about its mode.

    Parameters
    ----------
    draws : ndarray, shape (m, d)
        Scores drawn from the linear model, where chains start and by which they are whitened.
    known : mapping of str to float
        What is held, for people to read.

    Raises
    ------
    Refusal
        Where no motion with deviations can be followed.
    """
    about, parameters, solver, data = result.about, result.fit.parameters, result.solver, weighing.data
    if about is None or result.weighed is None:
        raise Refusal(ESCAPED)
    z = about.u[: parameters.free.size]
    target = Target(
        Signal(data.t, data.y, data.quantity),
        Oscillator(result.candidate.damping, result.candidate.restoring),
        "gaussian",
        parameters.priors,
        {**parameters.known, "epsilon": solver.epsilon, **known},
        deviation=_deviation(weighing, result),
    )
    likelihood = Likelihood.near(target, z, TOLERANCE * data.recorded_amplitude)
    return Mode(
        z,
        likelihood.log_posterior(z),
        np.linalg.inv(np.atleast_2d(np.cov(draws.T))),
        likelihood,
        linear=LinearPosterior(draws, float(result.weighed.log_evidence)),
    )


def _deviation(weighing: Weighing, result: Result) -> Deviation:
    """Return the deviations about those of the mode, with the combinations of hyperparameters that count."""
    about, weighed = result.about, result.weighed
    assert about is not None
    assert weighed is not None
    parameters, solver = result.fit.parameters, result.solver
    n, d = solver.knots.size, parameters.free.size
    g, h = about.u[d : d + n], about.u[d + n :]
    tangents = columns_at(solver, result.fit, about.u, SEARCHED)
    if tangents is None:
        raise Refusal(ESCAPED)
    columns = tangents[:, d:]
    basis, upper = np.linalg.qr(columns)
    grid = grid_of(n, absorbed=parameters.absorbs)
    kept = weighed.probable(NEGLIGIBLE)
    near = motions_near(solver, parameters, result.fit.active, weighed, float(np.sqrt(weighing.variance)))
    probabilities = np.bincount(weighed.combos, weighed.weights, minlength=grid.log_prior.size)[kept]
    return Deviation(
        Deviating(near, np.expm1(g), h, parameters.known),
        weighing.variance,
        weighing.samples,
        basis,
        columns @ np.concatenate([g, h]),
        grid.log_prior[kept],
        grid.factors[kept],
        upper @ grid.factors[kept] / np.sqrt(weighing.variance),
        probabilities / probabilities.sum(),
    )
