"""Which noise a record has: one answer for all dampings that are compared on it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from bayesdamp.inference.fit.laplace import log_evidence_near
from bayesdamp.inference.fit.mode import Mode
from bayesdamp.inference.fit.search import find_mode
from bayesdamp.inference.model.target import Target
from bayesdamp.inference.noise import NOISES
from bayesdamp.inference.noise._residuals import fit_noise
from bayesdamp.records.oscillation.features import Features
from bayesdamp.types import OK, Refusal, Seed, Signal

FIRST = "correlated"
"""Noise of the first fit, where it is in play: white noise is its limit."""
MARGIN = 30.0
"""Nats by which a noise model must be behind on the residuals of another's fit to need no fit of its own: what a fit of
its own gains is of the order of one nat for each of the dozen parameters that move the trajectory."""

Build = Callable[[str], Target]


@dataclass(frozen=True)
class Fitted:
    """The mode under one noise model; log_evidence by Laplace's approximation, in nats."""

    target: Target
    mode: Mode
    log_evidence: float


@dataclass(frozen=True)
class Weighed:
    """One noise model: log evidence by Laplace's approximation (nats), and its parameters.

    held: whether it is judged by the residuals of another model's fit, being far behind there.
    """

    noise: str
    log_evidence: float = -np.inf
    values: Mapping[str, float] = field(default_factory=dict)
    held: bool = False
    outcome: str = OK


def first_noise(names: Sequence[str], signal: Signal) -> str:
    """The noise model that a record is fitted under before one is chosen. Raises Refusal where it is none for any."""
    refused = []
    for name in sorted(names, key=lambda n: n != FIRST):
        try:
            NOISES.get(name).read(signal)
        except Refusal as refusal:
            refused.append(str(refusal))
            continue
        return name
    raise Refusal("; ".join(refused))


def fit_with(target: Target, seeds: Mapping[Seed, Mapping[str, float]], features: Features) -> Fitted:
    """The mode of one target and its evidence. Raises Refusal."""
    mode = find_mode(target, seeds, noise_level=features.roughness, period=features.period, thrifty=True)
    return Fitted(target, mode, log_evidence_near(mode.likelihood, mode.z))


def weigh_noises(build: Build, fitted: Fitted, features: Features, names: Sequence[str]) -> list[Weighed]:
    """Every noise model in `names`, in their order, on one record under one damping and restoring law.

    build: noise to target, raising Refusal where the record is none for it; fitted: the fit under one of the models.
    All densities are of the record in its unit, those of rounded values divided by their step, so that the evidence
    is on one scale.
    """
    signal, own = fitted.target.signal, fitted.target.noise
    r = fitted.mode.likelihood.residual(fitted.mode.z)
    base = fit_noise(own, r, signal, features).log_evidence
    start = {n: float(v) for n, v in fitted.target.values(fitted.mode.z).items()}
    found: list[Weighed] = []
    best = fitted.log_evidence
    for name in sorted(names, key=lambda n: n != own):
        try:
            if name == own:
                found.append(_weighed(fitted))
                continue
            other = fit_noise(name, r, signal, features)
            there = fitted.log_evidence + other.log_evidence - base
            if there < best - MARGIN:
                found.append(Weighed(name, there, other.values, held=True))
                continue
            fresh = fit_with(build(name), {Seed(f"with {own} noise"): start}, features)
        except Refusal as refusal:
            found.append(Weighed(name, outcome=str(refusal)))
            continue
        best = max(best, fresh.log_evidence)
        found.append(_weighed(fresh))
    return sorted(found, key=lambda w: names.index(w.noise))


def chosen_noise(weighed: Sequence[Weighed]) -> str:
    """The noise of highest evidence. Raises Refusal where none could be weighed."""
    usable = [w for w in weighed if w.outcome == OK and np.isfinite(w.log_evidence)]
    if not usable:
        raise Refusal("no noise model leads to a finite likelihood")
    return max(usable, key=lambda w: w.log_evidence).noise


def _weighed(fitted: Fitted) -> Weighed:
    target, mode = fitted.target, fitted.mode
    values = {n: float(v) for n, v in target.values(mode.z).items()}
    own = {n: v for n, v in values.items() if n not in target.oscillator.parameters}
    return Weighed(target.noise, fitted.log_evidence, own)
