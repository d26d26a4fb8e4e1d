"""Find where searches for a mode start: on a record, and at a fit of all dampings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from bayesdamp.estimators import run as run_estimator
from bayesdamp.estimators.shared import decay_start, start_parameters
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.records.oscillation.features import Features
from bayesdamp.types import Problem, Refusal, Seed, Signal

Starts = Mapping[Seed, Mapping[str, float]]
"""Parameter values by name, from each source of a start."""
REGRESSION = "least_squares"
"""The estimator that gives a start where a study has none."""
OBSERVED = Seed("frequency and decay")
"""The start from the record's turning points. A regression on derivatives is far off where noise hides these, as in a
record of the acceleration."""
ALL = Seed("fit of all dampings")
"""The start with the motion of the fit under which the noise was chosen, which stays in phase with the record."""


def regression(signal: Signal, problem: Problem) -> tuple[dict[Seed, Mapping[str, float]], str]:
    """Return the values of least squares, and its outcome."""
    estimates = run_estimator(REGRESSION, signal, problem, stages=("initial",), seed=0)
    return {Seed(REGRESSION, e.stage): e.values for e in estimates if e.values}, estimates[0].outcome


def observed(signal: Signal, features: Features, problem: Problem) -> dict[Seed, Mapping[str, float]]:
    """Return the start that the record shows; nothing where it cannot be read.

    It is the restoring law of the record's frequency and midline, its smoothed start, and the damping of its
    decrements.
    """
    try:
        values = start_parameters(signal, problem, features)
    except Refusal:
        return {}
    return {OBSERVED: values | decay_start(problem, features)}


def of_all(
    fit: Mapping[str, float],
    damping: Sequence[str],
    problem: Problem,
    decays: Mapping[Seed, Mapping[str, float]],
) -> dict[Seed, Mapping[str, float]]:
    """Return the start with the motion of a fit of all dampings.

    Its damping is that of the record's decrements, because fewer terms have to account for the whole decay. It is the
    fit's own where no other is known or the terms are the same.

    Parameters
    ----------
    fit
        Parameters of the fit, by name.
    damping
        Its damping terms.
    problem
        The terms and the system that need a start.
    decays
        What `observed` returned.
    """
    oscillator = Oscillator(problem.damping, problem.system.restoring)
    motion = {n: fit[n] for n in (*oscillator.law.parameters, "theta0", "omega0") if n in fit}
    own = {n: v for n, v in fit.items() if n in oscillator.coefficients}
    decay = {n: v for n, v in decays.get(OBSERVED, {}).items() if n in oscillator.coefficients}
    return {ALL: motion | own | ({} if tuple(damping) == problem.damping else decay)}
