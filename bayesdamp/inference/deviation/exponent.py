"""Infer the exponent p of a damping force c |v|^p against the velocity v.

At each of several exponents the other parameters are fitted and the evidence is computed (`slices`); the posterior of p
is interpolated between them. A model that is linear in p would fail unless the record determines p well, because p and
the log deviation of the damping, g, are nearly degenerate: a g that changes with the amplitude has the same effect as
another p, and along this degeneracy the coefficient c follows a curve.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy  # loads its modules when they are used

from bayesdamp.inference.deviation.candidate import MotionCandidate
from bayesdamp.inference.deviation.draws import orbit_of, unit_works
from bayesdamp.inference.deviation.model_comparison import ModelComparison
from bayesdamp.inference.deviation.slices import ONE_SLICE_SD, slice_proposal
from bayesdamp.physics.kernel import Solver

LEAST_EXPONENT, MOST_EXPONENT = 0.0, 3.0
"""Ends of the uniform prior of the exponent p of a damping force c |v|^p."""
ROUNDED = 0.002
"""Width of the smoothing of a power p < 1 near zero velocity, at most this fraction of the peak velocity. A larger
width would change the power at small amplitudes."""
ASIDE = (0.0, -0.4, 0.4)
"""Exponents at which fits of a power law start, minus the local exponent of the best candidate (that of its damping
against velocity) at the middle amplitude."""
NEAR = 1.5
"""The local exponent (that of the damping force against velocity) at the middle amplitude is computed from the damping
at two amplitudes: the middle one times and divided by this factor."""
DRAWS = 4000
"""Number of draws of the exponent from the posterior of the linear model about the mode, where one linear model is
enough (`slices.ONE_SLICE_SD`)."""
MOST_ABOVE = 7.0
"""An interpolation of log evidences that exceeds the largest of them by more than this, in nats, is not used: next to a
drop of thousands of nats it overshoots (conventional)."""
LEVELS = (np.arange(400) + 0.5) / 400
"""Equidistant probabilities at which quantiles of the exponent of a power law are returned; the 400 quantiles serve as
draws."""
POINTS = 3001
"""Number of exponents at which the posterior, interpolated between the slices, is computed."""


def exponent_quantiles(comparison: ModelComparison) -> tuple[float, ...]:
    """Return quantiles of the exponent p of a damping force c |v|^p at the probabilities `LEVELS`.

    The coefficient and all other unknowns are integrated out. The restoring law is that of the best candidate; an empty
    tuple is returned if this comparison has no result of a power law alone, or if no motion fits at the exponents
    around the most probable one. The prior of the exponent is uniform (from `LEAST_EXPONENT` to `MOST_EXPONENT`); if
    one linear model is enough (`slices.ONE_SLICE_SD`), it has no effect.
    """
    if not comparison.results:
        return ()
    alone = MotionCandidate(("power",), comparison.best.candidate.restoring)
    result = next((r for r in (*comparison.results, *comparison.forms) if r.candidate == alone), None)
    if result is None or "exponent" not in result.fit.parameters.priors:
        return ()
    parameters, prior = result.fit.parameters, result.fit.parameters.priors["exponent"]
    proposal = slice_proposal(comparison, result, parameters, result.posterior)
    if proposal is None:
        scores = result.posterior.draws(DRAWS, np.random.default_rng(0))[0][
            :, parameters.free_names.index("exponent")
        ]
        if np.std(scores) >= ONE_SLICE_SD:
            return ()
        p = prior.value(scores)
        return tuple(np.quantile(np.clip(p, LEAST_EXPONENT, MOST_EXPONENT), LEVELS).tolist())
    p = prior.value(np.array([part.middle for part in proposal.slices]))
    log = np.array([part.posterior.log_evidence for part in proposal.slices])
    return _quantiles(p, log) if p.size > 1 else ()


def power_solver(comparison: ModelComparison, p: float) -> Solver:
    """Return a solver with the terms of the best candidate's solver and a power |v|^p, under the best restoring law.

    The exponent remains a parameter of the solver; p only decides a width: for p < 1 the width of the velocity range in
    which forces are smoothed at v = 0 is at most `ROUNDED` of the peak velocity, else it is that of the candidate's
    solver.
    """
    plain = comparison.solvers[comparison.best.candidate.restoring]
    narrow = min(plain.epsilon, ROUNDED * comparison.reference.peak_velocity)
    # From p = 1 the usual width has no effect on the power, and a narrow one would need ten times as many steps.
    terms = tuple(dict.fromkeys([*plain.terms, "power"]))
    return replace(plain, terms=terms, epsilon=narrow if p < 1 else plain.epsilon)


def exponent_starts(comparison: ModelComparison) -> list[float]:
    """Return three exponents at which fits may start, each limited to the range of the prior.

    The first is 1 + d log ζ / d log A at the middle amplitude, where ζ(A) is the damping ratio of the best candidate at
    amplitude A. The others are smaller and larger (`ASIDE`). The list is empty if the best candidate cannot oscillate
    at this amplitude or loses no energy there.
    """
    best, middle = comparison.best, comparison.data.middle
    solver = comparison.solvers[best.candidate.restoring]
    ratios = []
    for a in (middle.amplitude * NEAR, middle.amplitude / NEAR):
        orbit = orbit_of(best, a)
        if orbit is None:
            return []
        works = unit_works(orbit, solver, best.further, best.fit.active)[0]
        ratios.append(float(works @ best.values[: works.size]) / orbit.energy)
    if min(ratios) <= 0:
        return []
    steep = 1 + float(np.log(ratios[0] / ratios[1])) / (2 * np.log(NEAR))
    return np.clip(steep + np.array(ASIDE), LEAST_EXPONENT, MOST_EXPONENT).tolist()


def _quantiles(p: np.ndarray, log: np.ndarray) -> tuple[float, ...]:
    """Return quantiles of the exponent at `LEVELS`, from log evidences `log` (nats) at rising exponents p, (m,) each.

    The log evidence is interpolated between the first and the last of them; the prior is uniform from `LEAST_EXPONENT`
    to `MOST_EXPONENT`.
    """
    low, high = np.clip(p[[0, -1]], LEAST_EXPONENT, MOST_EXPONENT)
    grid = np.linspace(low, high, POINTS)
    values = scipy.interpolate.PchipInterpolator(p, log)(grid)
    if p.size > 2:
        smooth = scipy.interpolate.Akima1DInterpolator(p, log, method="makima", extrapolate=True)(grid)
        # PCHIP is monotonic between two exponents, so it never overshoots.
        values = smooth if smooth.max() < log.max() + MOST_ABOVE else values
    density = np.exp(values - values.max())
    total = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]))])
    # Add a slope, so that the cumulative probability can be inverted everywhere.
    return tuple(np.interp(LEVELS, total / total[-1] + 1e-12 * np.arange(POINTS), grid).tolist())
