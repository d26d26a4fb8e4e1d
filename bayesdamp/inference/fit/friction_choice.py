"""How sharply friction turns over on a record, where nobody said: one ε for all candidates that are compared on it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from bayesdamp.inference.fit.laplace import value_sds
from bayesdamp.inference.fit.noise_choice import Fitted, fit_with
from bayesdamp.inference.model.defaults import EPSILON_SHARE
from bayesdamp.inference.model.target import Target
from bayesdamp.records.oscillation.features import Features
from bayesdamp.types import OK, Refusal, Seed

SHARES = (0.05, EPSILON_SHARE, 0.01, 0.005, 0.002, 0.001, 0.0005)
"""ε as shares of the peak velocity, over the range that its prior has where it is inferred."""
LEAD = 3.0
"""Nats by which another ε must be ahead of the usual one: of the few that are tried one is ahead of it by chance."""
WORTH = 1.0
"""Nats that a share between two of those must promise to be tried."""
BETWEEN = 5
"""Shares that may be tried there."""
SHOWN = 2.0
"""Standard deviations by which the fitted friction must be above zero: a record that loses but two nats without any
does not say how it turns over."""


@dataclass(frozen=True)
class Tried:
    """One ε, as a share of the peak velocity and in rad/s: the log evidence by Laplace's approximation, in nats, and
    each damping coefficient's value and sd."""

    share: float
    epsilon: float
    log_evidence: float = -np.inf
    coefficients: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    outcome: str = OK


def weigh_epsilons(
    build: Callable[[float], Target], usual: Fitted, peak: float, features: Features
) -> tuple[Fitted, list[Tried]]:
    """The fit under the ε that suits the record, and all that were tried, from the roundest.

    build: ε (rad/s) to the target; usual: the fit under the usual one, all damping terms in it; peak: the peak
    velocity (rad/s). Sharper ones are tried for as long as the evidence rises; rounder ones where none is better; then
    those between, for as long as a parabola through the best and its neighbours promises more; and none where there is
    hardly any friction.
    """
    first = SHARES.index(EPSILON_SHARE)
    tried = {EPSILON_SHARE: _seen(EPSILON_SHARE, EPSILON_SHARE * peak, usual)}
    if not _shown(usual):
        return usual, list(tried.values())
    best = usual
    for shares in (SHARES[first + 1 :], SHARES[:first][::-1]):
        if best is not usual:
            break
        for share in shares:
            found, fit = _tried(build, best, share, share * peak, features)
            tried[share] = found
            if fit is None or fit.log_evidence <= best.log_evidence:
                break
            best = fit
    for _ in range(BETWEEN):
        share = _between([t for t in tried.values() if t.outcome == OK])
        if share is None or share in tried:
            break
        tried[share], fit = _tried(build, best, share, share * peak, features)
        best = fit if fit is not None and fit.log_evidence > best.log_evidence else best
    ahead = best.log_evidence - usual.log_evidence > LEAD
    return best if ahead else usual, sorted(tried.values(), key=lambda t: -t.share)


def _between(tried: Sequence[Tried]) -> float | None:
    """The share at the top of the parabola through the best and its two neighbours; None where the best has but one, or
    the parabola promises little. (What friction does wrong grows in proportion to how wrong ε is.)"""
    order = sorted(tried, key=lambda t: t.share)
    top = max(range(len(order)), key=lambda i: order[i].log_evidence)
    if not 0 < top < len(order) - 1:
        return None
    best = order[top]
    x = [t.share - best.share for t in (order[top - 1], order[top + 1])]
    below = [t.log_evidence - best.log_evidence for t in (order[top - 1], order[top + 1])]
    bent, slope = np.linalg.solve([[x[0] ** 2, x[0]], [x[1] ** 2, x[1]]], below)
    if not (bent < 0 and -(slope**2) / (4 * bent) > WORTH):
        return None
    return float(f"{best.share - slope / (2 * bent):.3g}")


def _shown(fit: Fitted) -> bool:
    """Whether any friction stands out from zero in a fit."""
    sd, names = fit.mode.sd(), fit.target.names
    switching = [names.index(term.parameter) for term in fit.target.oscillator.terms if term.switches]
    return any(abs(fit.mode.z[i]) > SHOWN * sd[i] for i in switching)


def _tried(
    build: Callable[[float], Target], near: Fitted, share: float, epsilon: float, features: Features
) -> tuple[Tried, Fitted | None]:
    """One ε, its search begun where another's ended; without a fit where it has none."""
    start = {n: float(v) for n, v in near.target.values(near.mode.z).items()}
    try:
        fit = fit_with(build(epsilon), {Seed("under another ε"): start}, features)
    except Refusal as refusal:
        return Tried(share, epsilon, outcome=str(refusal)), None
    return _seen(share, epsilon, fit), fit


def _seen(share: float, epsilon: float, fit: Fitted) -> Tried:
    target, mode = fit.target, fit.mode
    values, sds = target.values(mode.z), value_sds(target, mode.z, mode.factor @ mode.factor.T)
    coefficients = {n: (float(values[n]), sds[n]) for n in target.oscillator.coefficients}
    return Tried(share, epsilon, fit.log_evidence, coefficients)


def epsilon_note(tried: Sequence[Tried], chosen: float | None, unit: str) -> str:
    """What a report says of the choice. chosen: ε in rad/s, None where the usual one stays; unit: of a displacement."""
    if chosen is None:
        return ""
    usual = next(t for t in tried if t.share == EPSILON_SHARE)
    best = next(t for t in tried if t.epsilon == chosen)
    ahead = best.log_evidence - usual.log_evidence
    return (
        f"ε was not given: {100 * best.share:g} % of the peak velocity, {chosen:.3g} {unit}/s, which suits the record "
        f"best ({ahead:.3g} nats ahead of the usual {100 * EPSILON_SHARE:g} %)."
    )
