"""Which noise a record has: one answer for all dampings that are compared on it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.special import log_ndtr

from bayesdamp.inference.build import build_target
from bayesdamp.inference.checks import structure
from bayesdamp.inference.defaults import Reference
from bayesdamp.inference.mode import find_mode
from bayesdamp.inference.target import LOG_2PI
from bayesdamp.priors import Prior
from bayesdamp.signals.features import Features
from bayesdamp.types import OK, Refusal, Signal, System


@dataclass(frozen=True)
class Weighed:
    """One noise model under the widest damping: log evidence by Laplace's approximation (nats), its parameters at the
    mode, and the chance of so much structure in whitened residuals if it were right."""

    noise: str
    log_evidence: float = -np.inf
    values: Mapping[str, float] = field(default_factory=dict)
    predictive_p: float = np.nan
    outcome: str = OK


def weigh_noises(
    signal: Signal,
    damping: tuple[str, ...],
    system: System,
    features: Features,
    reference: Reference,
    *,
    names: Sequence[str],
    seeds: Mapping[str, Mapping[str, float]],
    term_priors: Mapping[str, Prior] | None = None,
    seed: int = 0,
) -> list[Weighed]:
    """Every noise model in `names`, in their order, on one record under one damping.

    damping: all terms that are compared, so that no noise model makes up for a term that is missing. seeds: as
    `find_mode` takes them; modes found under one noise are seeds for those after it. All densities are of the record
    in its unit, those of rounded values divided by their step, so that the evidence is on one scale. A model that
    is none for the record says so in its outcome.
    """
    found: list[Weighed] = []
    tried = dict(seeds)
    for name in names:
        try:
            target = build_target(
                signal, damping, system, features, reference, noise=name, term_priors=term_priors
            )
            mode = find_mode(target, tried, noise_level=features.roughness)
        except Refusal as refusal:
            found.append(Weighed(name, outcome=str(refusal)))
            continue
        values = {n: float(v) for n, v in target.values(mode.z).items()}
        tried[f"with {name} noise"] = values
        volume = -0.5 * float(np.linalg.slogdet(mode.information)[1])
        evidence = mode.log_posterior + 0.5 * mode.z.size * LOG_2PI + volume
        # Both mirror images of a folded score belong to it; near zero they are one.
        folded = np.asarray(target.layout.folded)
        evidence += float(np.sum(_mirrors(mode.z[folded] / mode.sd()[folded])))
        p = structure(target, mode, features.period, seed)
        own = {n: v for n, v in values.items() if n not in target.oscillator.parameters}
        found.append(Weighed(name, evidence, own, p))
    return found


def chosen_noise(weighed: Sequence[Weighed]) -> str:
    """The noise of highest evidence. Raises Refusal where none could be weighed."""
    usable = [w for w in weighed if w.outcome == OK and np.isfinite(w.log_evidence)]
    if not usable:
        raise Refusal("no noise model leads to a finite likelihood")
    return max(usable, key=lambda w: w.log_evidence).noise


def _mirrors(away: np.ndarray) -> np.ndarray:
    """Log mass of a normal on its own side and its mirror's, mode `away` sds from zero, against one whole normal."""
    return np.log(2.0) + log_ndtr(away)
