"""Compute how sensitive a candidate's evidence is to the widths of the priors of damping coefficients."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict

from bayesdamp.inference.deviation.single import replace_priors
from bayesdamp.inference.mode import Mode
from bayesdamp.inference.sensitivity import evidence_by_prior_width, under_priors
from bayesdamp.outcomes import following
from bayesdamp.pipeline.candidates.candidate import StudyCandidate
from bayesdamp.pipeline.tasks import Product
from bayesdamp.priors import Prior
from bayesdamp.store.contents import WidthsContent
from bayesdamp.types import OK, Refusal


def compute_widths(candidate: StudyCandidate, seed: int) -> Product:
    """Return the log evidence (nats) with the priors of all damping coefficients scaled by each of several factors.

    The factors are `PRIOR_FACTORS`. The evidence is from the reweighted draws of importance sampling, or from new ones
    with the given seed (see `evidence_by_prior_width`); the arrays are the fields of `Widths`. Raises Refusal if
    importance sampling has stored no draws.
    """
    source = candidate.store.read(f"evidence/{candidate.path}/importance")
    if not source.arrays:
        reason = "not applicable: the draws for this are not stored; run the study again with --fresh"
        raise Refusal(following(source.name, source.outcome) if source.outcome != OK else reason)
    y, log_weights = (source.arrays[n].astype(float) for n in ("y", "log_weights"))
    law, (target, mode) = candidate.fit.law, candidate.fit.engine

    def fit_under(priors: Mapping[str, Prior]) -> Mode:
        return under_priors(mode, priors) if law is None else replace_priors(law, priors).mode

    coefficients = target.oscillator.coefficients
    widths = asdict(evidence_by_prior_width(target.priors, coefficients, y, log_weights, fit_under, seed))
    varied = widths.pop("varied")
    return Product(WidthsContent(tuple(varied)), widths)
