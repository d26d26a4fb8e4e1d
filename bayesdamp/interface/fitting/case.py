"""Damping terms and a system on a record: its features, the targets, and where searches start."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from bayesdamp import types
from bayesdamp.estimators.shared import has_noise
from bayesdamp.inference.fit.mode import Mode
from bayesdamp.inference.fit.search import find_mode
from bayesdamp.inference.model.target import Target, build_target
from bayesdamp.interface.fitting.specification import Specification
from bayesdamp.interface.fitting.starts import observed, regression
from bayesdamp.priors import Prior
from bayesdamp.records.oscillation.features import Features, features
from bayesdamp.records.reference import reference_of
from bayesdamp.types import Problem, Reference, Refusal, Seed, System

Starts = Mapping[Seed, Mapping[str, float]]
NO_POSTERIOR = "the record has no noise, so there is no posterior; give noise_sd to simulate"


@dataclass(frozen=True)
class Case:
    """Damping terms and a system on a record with an oscillation.

    Attributes
    ----------
    signal : Signal
        The record.
    terms : tuple of str
        Damping terms.
    system : System
        What is known and believed of all but the damping.
    term_priors : mapping of str to Prior
        The priors that are given, by term.
    seen : Features
        Of the record.
    reference : Reference
        What default priors scale with.
    """

    signal: types.Signal
    terms: tuple[str, ...]
    system: System
    term_priors: Mapping[str, Prior]
    seen: Features
    reference: Reference

    @classmethod
    def of(cls, signal: types.Signal, model: Specification) -> Case:
        """Return a model on a record. Raises Refusal where the record shows no oscillation."""
        seen, system = features(signal), model.system
        return cls(signal, model.terms, system, model.term_priors, seen, reference_of(system, seen))

    @classmethod
    def with_noise(cls, signal: types.Signal, model: Specification) -> Case:
        """Return the same. Raises Refusal also where the record has no noise to weigh by."""
        case = cls.of(signal, model)
        if not has_noise(signal, case.seen):
            raise Refusal(NO_POSTERIOR)
        return case

    @property
    def problem(self) -> Problem:
        """As estimators are asked."""
        return Problem(self.terms, self.system)

    def target(self, noise: str, epsilon: float | None = None) -> Target:
        """Return the target under a noise model. epsilon: friction's width (rad/s), where it was chosen for the record.

        Raises Refusal where the record is not one for this noise.
        """
        system = self.system
        if epsilon is not None:
            system = replace(system, known={**system.known, "epsilon": epsilon})
        return build_target(
            self.signal,
            self.terms,
            system,
            self.seen,
            self.reference,
            noise=noise,
            term_priors=self.term_priors,
        )

    def mode(self, target: Target, seeds: Starts, thrifty: bool = False) -> Mode:
        """Return the highest mode of a target that is reached from seeds. Raises Refusal where there is none."""
        return find_mode(
            target, seeds, noise_level=self.seen.roughness, period=self.seen.period, thrifty=thrifty
        )

    def starts(self) -> Starts:
        """Return what the record's turning points and a regression say. Raises Refusal where neither says anything."""
        values, outcome = regression(self.signal, self.problem)
        starts = observed(self.signal, self.seen, self.problem) | values
        if not starts:
            raise Refusal(outcome)
        return starts
