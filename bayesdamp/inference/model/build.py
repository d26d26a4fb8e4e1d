"""A target from what a study knows: which parameters are inferred, with which priors."""

from __future__ import annotations

from collections.abc import Mapping

from bayesdamp.inference.model.defaults import EPSILON_SHARE, Reference, default_prior
from bayesdamp.inference.model.target import ABSENT, SHARED_ABSENT, Target
from bayesdamp.inference.noise import NOISES
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.physics.solver.friction import no_exact_switch
from bayesdamp.priors import Prior
from bayesdamp.records.oscillation.features import Features
from bayesdamp.types import Refusal, Signal, System


def build_target(
    signal: Signal,
    damping: tuple[str, ...],
    system: System,
    features: Features,
    reference: Reference,
    *,
    noise: str = "gaussian",
    term_priors: Mapping[str, Prior] | None = None,
    beside: tuple[str, ...] = (),
) -> Target:
    """The target of one damping model on one record.

    term_priors: prior of a damping term's coefficient by the term's name; the others have the default.
    beside: all terms of the models that this one is compared with, its own among them. Those it lacks then stay in the
    target with a coefficient that is 0 at every score, so that all these models are one compiled program; such a
    score's prior integrates to one, and the evidence is the model's own.
    Raises ValueError where a parameter has neither a value nor a prior, Refusal where the record is not one for this
    noise, or JAX does not have a term's force.
    """
    osc = Oscillator(beside or damping, system.restoring)
    absent = [t.parameter for t in osc.terms if t.name not in damping]
    by_term = {t.parameter: (term_priors or {}).get(t.name) for t in osc.terms}
    given: dict[str, object] = {**system.free, **{k: v for k, v in by_term.items() if v is not None}}
    known = {**system.known, **NOISES.get(noise).read(signal)}
    if osc.switches and "epsilon" not in known and "epsilon" not in system.free:
        known["epsilon"] = EPSILON_SHARE * reference.peak_velocity
    more = [t for t in osc.terms if not t.shaped]
    untraced = [t for t in more if t.untraced]
    if untraced:
        raise Refusal(f"{untraced[0].name} damping is weighed and simulated only: {untraced[0].untraced}")
    if known.get("epsilon") == 0.0 and any(t.switches for t in more):
        raise Refusal(no_exact_switch(next(t.name for t in more if t.switches)))
    scales = reference.scales(features.rest)
    known = {**{n: scales[n] for n in osc.scales}, **known}
    wanted = (*osc.coefficients, *(n for n in osc.parameters if n not in osc.coefficients))
    wanted = (*wanted, *NOISES.get(noise).parameters)
    priors: dict[str, Prior] = {}
    for name in wanted:
        if name in known and name not in osc.coefficients:
            continue
        prior = given.get(name)
        if name in absent:  # of the kind that it has where it is present
            prior = SHARED_ABSENT if prior is None else ABSENT
        priors[name] = prior if prior is not None else default_prior(name, osc, noise, reference, features)  # type: ignore[assignment]
    return Target(signal, osc, noise, priors, {k: v for k, v in known.items() if k not in priors})
