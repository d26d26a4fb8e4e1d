"""A target from what a study knows: which parameters are inferred, with which priors."""

from __future__ import annotations

from collections.abc import Mapping

from bayesdamp.inference.model.defaults import default_prior
from bayesdamp.inference.model.target import Target
from bayesdamp.inference.noise import NOISES
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.priors import Prior
from bayesdamp.records.oscillation.features import Features
from bayesdamp.types import Reference, Signal, System


def build_target(
    signal: Signal,
    damping: tuple[str, ...],
    system: System,
    features: Features,
    reference: Reference,
    *,
    noise: str = "gaussian",
    term_priors: Mapping[str, Prior] | None = None,
) -> Target:
    """The target of one damping model on one record.

    term_priors: prior of a damping term's coefficient by the term's name; the others have the default.
    Raises ValueError where a parameter has neither a value nor a prior, Refusal where the record is not one for this
    noise.
    """
    osc = Oscillator(damping, system.restoring)
    by_term = {t.parameter: (term_priors or {}).get(t.name) for t in osc.terms}
    given: dict[str, object] = {**system.free, **{k: v for k, v in by_term.items() if v is not None}}
    known = {**system.known, **NOISES.get(noise).read(signal)}
    if osc.switches and "epsilon" not in known and "epsilon" not in system.free:
        known["epsilon"] = reference.friction_width
    scales = reference.scales(features.rest)
    known = {**{n: scales[n] for n in osc.scales}, **known}
    priors: dict[str, Prior] = {}
    for name in (*osc.parameters, *NOISES.get(noise).parameters):
        if name not in known or name in osc.coefficients:
            priors[name] = given.get(name) or default_prior(name, osc, noise, reference, features)  # type: ignore[assignment]
    return Target(signal, osc, noise, priors, {k: v for k, v in known.items() if k not in priors})
