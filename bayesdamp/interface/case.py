"""Combine a model with a record: its features, the targets, where searches start, and the search for the mode."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from bayesdamp import types
from bayesdamp.estimators import run as run_estimator
from bayesdamp.estimators.shared import decay_start, has_noise, start_parameters
from bayesdamp.inference.fit.mode import Mode
from bayesdamp.inference.fit.search import find_mode, prior_starts
from bayesdamp.inference.model.target import Target, build_target
from bayesdamp.interface.specification import Specification
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.records.oscillation.features import Features, features
from bayesdamp.records.reference import reference_of
from bayesdamp.types import Problem, Reference, Refusal, Seed, Signal

Starts = Mapping[Seed, Mapping[str, float]]
"""Parameter values by name, from each source of a start."""
NO_POSTERIOR = "the record has no noise, so there is no posterior; give noise_sd to simulate"
PRIOR_STARTS = 2
"""Number of draws from the prior that searches start from, in addition to the starts from the record."""
REGRESSION = "least_squares"
"""The estimator that gives a start where a study has none."""
OBSERVED = Seed("frequency and decay")
"""The start from the record's turning points. A regression on derivatives is far off where noise hides these, as in a
record of the acceleration."""
ALL = Seed("fit of all dampings")
"""The start with the motion of the fit under which the noise was chosen, which stays in phase with the record."""


@dataclass(frozen=True)
class Case:
    """A model on a record with an oscillation, where laws hold exactly.

    Attributes
    ----------
    signal
        The record.
    model
        The model.
    features
        Features of the record.
    reference
        What default priors scale with.
    """

    signal: types.Signal
    model: Specification
    features: Features
    reference: Reference

    @classmethod
    def of(cls, signal: types.Signal, model: Specification) -> Case:
        """Return a model on a record. Raises Refusal where the record shows no oscillation."""
        own = features(signal)
        return cls(signal, model, own, reference_of(model.system, own))

    @classmethod
    def with_noise(cls, signal: types.Signal, model: Specification) -> Case:
        """Return a model on a record. Raises Refusal also where the record has no noise."""
        case = cls.of(signal, model)
        if not has_noise(signal, case.features):
            raise Refusal(NO_POSTERIOR)
        return case

    @property
    def problem(self) -> Problem:
        """The damping terms and the system, as estimators need them."""
        return Problem(self.model.terms, self.model.system)

    def target(self, noise: str, epsilon: float | None = None) -> Target:
        """Return the target under a noise model.

        Parameters
        ----------
        noise
            The noise model.
        epsilon
            Width of friction in rad/s, where it was chosen for the record.

        Raises
        ------
        Refusal
            Where the record is not suited to this noise model.
        """
        system = self.model.system
        if epsilon is not None:
            system = replace(system, known={**system.known, "epsilon": epsilon})
        return build_target(
            self.signal,
            self.model.terms,
            system,
            self.features,
            self.reference,
            noise=noise,
            term_priors=self.model.term_priors,
        )

    def mode(
        self,
        noise: str,
        epsilon: float | None,
        starts: Starts,
        *,
        draws: int = PRIOR_STARTS,
        seed: int = 0,
        thrifty: bool = False,
    ) -> Mode:
        """Return the highest mode that a search reaches.

        Parameters
        ----------
        noise, epsilon
            As in `target`.
        starts
            Where the search starts.
        draws
            Number of draws from the prior that it starts from too.
        seed
            Seed of these draws.
        thrifty
            Whether to stop at the first motion that keeps step with the record.

        Raises
        ------
        Refusal
            Where no start leads to a mode, or the record is not suited to the noise model.
        """
        target = self.target(noise, epsilon)
        return find_mode(
            target,
            {**starts, **prior_starts(target, draws, seed)},
            noise_level=self.features.roughness,
            period=self.features.period,
            thrifty=thrifty,
        )

    def starts(self) -> Starts:
        """Return starts from the record's turning points and a regression. Raises Refusal where neither gives one."""
        values, outcome = regression(self.signal, self.problem)
        starts = observed(self.signal, self.features, self.problem) | values
        if not starts:
            raise Refusal(outcome)
        return starts


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
