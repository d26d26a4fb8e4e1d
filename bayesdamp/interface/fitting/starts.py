"""Where the searches for a mode start, besides the estimates that a study asks for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from bayesdamp.estimators import run as run_estimator
from bayesdamp.estimators.shared import decay_start, start_parameters
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.records.oscillation.features import Features
from bayesdamp.types import Problem, Refusal, Seed, Signal

REGRESSION = "least_squares"
"""The estimator that is asked where a study has none."""
OBSERVED = Seed("frequency and decay")
"""The start that is read off the record's turning points: a regression on derivatives is far off where noise
hides these, as in a record of the acceleration."""

ALL = Seed("fit of all dampings")
"""The start that has the motion of the fit under which the noise was chosen, which keeps step."""


def regression(signal: Signal, problem: Problem) -> tuple[dict[Seed, Mapping[str, float]], str]:
    """Least squares' own values, and what it says where it has none."""
    found = run_estimator(REGRESSION, signal, problem, stages=("initial",), seed=0)
    return {Seed(REGRESSION, e.stage): e.values for e in found if e.values}, found[0].outcome


def observed(signal: Signal, seen: Features, problem: Problem) -> dict[Seed, Mapping[str, float]]:
    """The restoring law of the record's frequency and midline, its smoothed start, and the damping of its decrements;
    nothing where they cannot be read."""
    try:
        values = start_parameters(signal, problem, seen)
    except Refusal:
        return {}
    return {OBSERVED: values | decay_start(problem, seen)}


def of_all(
    fit: Mapping[str, float],
    damping: Sequence[str],
    problem: Problem,
    decays: Mapping[Seed, Mapping[str, float]],
) -> dict[Seed, Mapping[str, float]]:
    """The motion of a fit of all dampings, with the damping of the record's decrements, which one of fewer terms has to
    account for alone; with the fit's own where no other is known or it has the same terms.

    fit: its parameters by name; damping: its terms; decays: what `observed` found.
    """
    oscillator = Oscillator(problem.damping, problem.system.restoring)
    motion = {n: fit[n] for n in (*oscillator.law.parameters, "theta0", "omega0") if n in fit}
    own = {n: v for n, v in fit.items() if n in oscillator.coefficients}
    decay = {n: v for n, v in decays.get(OBSERVED, {}).items() if n in oscillator.coefficients}
    return {ALL: motion | own | ({} if tuple(damping) == problem.damping else decay)}
