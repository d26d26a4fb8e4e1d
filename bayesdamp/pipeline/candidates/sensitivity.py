"""The sensitivity of a branch's evidence: to the priors' width, to half the record, to the noise model, at zero."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict
from functools import partial

import numpy as np

from bayesdamp.inference.checks import carried_on
from bayesdamp.inference.deviation.single import first_half as first_half_of, replace_priors
from bayesdamp.inference.evidence import Draws
from bayesdamp.inference.mode import Mode, log_evidence_near
from bayesdamp.inference.sensitivity import (
    against_width,
    first_half,
    log_predictive,
    predict,
    savage_dickey,
    under_priors,
)
from bayesdamp.outcomes import following
from bayesdamp.pipeline.answering import likelihood_of
from bayesdamp.pipeline.candidates.branch import Branch
from bayesdamp.pipeline.tasks import Product
from bayesdamp.priors import Prior
from bayesdamp.store import CellResult
from bayesdamp.store.cells import Place
from bayesdamp.store.contents import (
    EvidenceContent,
    HalfContent,
    ModeContent,
    NoisesContent,
    RatiosContent,
    UnderNoise,
    WidthsContent,
)
from bayesdamp.types import OK, Refusal, Seed, candidate_name, candidate_parts

SHOWN = 1000
"""Least number of samples of a prediction that are stored, where there are as many."""


def sensitivity_cells(branch: Branch, keys: Mapping[str, str]) -> dict[str, str]:
    """Return the names of a branch's cells and the key of the cell that each starts from.

    Only the first repeat has them, and only where evidence is asked for. Where laws may hold approximately, deviations
    and κ take the place of other noise models. A record that is fitted jointly with others gets no searches of its own.

    Parameters
    ----------
    branch
        The candidate.
    keys
        The branch's other cells, name to key.
    """
    if branch.repeat or not any(Place.of(n).kind == "evidence" for n in keys):
        return {}
    study = branch.study
    is_joined = branch.spec.specimen in study.repeated and not study.posterior.samplers
    left_out = {
        *(["half", "noises"] if is_joined else []),  # these need searches of their own
        *(["noises"] if len(study.noises) < 2 or likelihood_of(study) == "law" else []),
        *(["savage_dickey"] if len(branch.terms) < 2 else []),
    }
    sources = {
        kind: source.format(branch.path) for kind, (source, _) in KINDS.items() if kind not in left_out
    }
    return {
        f"sensitivity/{branch.path}/{kind}": keys[source]
        for kind, source in sources.items()
        if source in keys
    }


def compute_sensitivity(branch: Branch, kind: str, seed: int) -> Product:
    """Compute one of these cells. Raises Refusal."""
    source_name, compute = KINDS[kind]
    source = branch.store.read(source_name.format(branch.path))
    if not source.arrays:
        reason = "not applicable: no draws were kept; run with --fresh"
        raise Refusal(following(source.name, source.outcome) if source.outcome != OK else reason)
    return compute(branch, source, seed)


def _compute_widths(branch: Branch, source: CellResult, seed: int) -> Product:
    y, log_weights = (source.arrays[n].astype(float) for n in ("y", "log_weights"))
    law, (target, mode) = branch.fit.law, branch.fit.engine

    def near(priors: Mapping[str, Prior]) -> Mode:
        return under_priors(mode, priors) if law is None else replace_priors(law, priors).mode

    coefficients = target.oscillator.coefficients
    widths = asdict(against_width(target.priors, coefficients, y, log_weights, near, seed))
    varied = widths.pop("varied")
    return Product(WidthsContent(tuple(varied)), widths)


def _compute_half(branch: Branch, source: CellResult, seed: int) -> Product:
    law, (_, mode), signal = branch.fit.law, branch.fit.engine, branch.record.signal
    if law is None:
        t, half = signal.t, first_half(mode)
        carry = partial(carried_on, mode.likelihood, half=signal.t.size // 2)
    else:
        data, single = law.comparison.data, first_half_of(law)
        t, half = float(signal.t[0]) + data.t, single.mode
        carry = partial(law.predict_second_half, single, seed=seed)
    evidence, ahead = predict(branch.model, half, carry, seed)
    whole = EvidenceContent.of(source).evidence
    assert whole is not None  # a source with draws was weighed
    density, uncertainty = log_predictive(whole, evidence)
    later = t[-ahead.error.size :]
    content = HalfContent(
        start=float(later[0]),
        rms=ahead.rms,
        expected=ahead.expected,
        coverage=ahead.coverage,
        log_predictive=density,
        log_predictive_stderr=uncertainty,
        evidence=evidence,
    )
    every = max(1, later.size // SHOWN)
    return Product(content, {"t": later[::every], "error": ahead.error[::every], "sd": ahead.sd[::every]})


def _compute_noises(branch: Branch, source: CellResult, seed: int) -> Product:
    """Return Laplace's log evidence under each noise model, from the mode under the chosen one."""
    del source, seed
    content = ModeContent.of(branch.store.read(f"mode/{branch.path}"))
    start, (whole, *_) = content.values, content.windows
    evidence: dict[str, UnderNoise] = {}
    for noise in branch.study.noises:
        if noise == branch.noise:
            evidence[noise] = UnderNoise(whole.log_evidence)
            continue
        try:
            begin = {Seed("under the chosen noise"): start}
            mode = branch.case.mode(noise, branch.epsilon, begin, draws=0, thrifty=True)
            evidence[noise] = UnderNoise(log_evidence_near(mode.likelihood, mode.z))
        except Refusal as refusal:
            evidence[noise] = UnderNoise(-np.inf, str(refusal))
    return Product(NoisesContent(branch.noise, evidence))


def _compute_ratios(branch: Branch, source: CellResult, seed: int) -> Product:
    """Return the evidence of each model with one term less, from the posterior density at zero."""
    del seed
    target, _ = branch.fit.engine
    z = Draws.of(target, source.arrays["draws"]).z
    scores = dict(zip(target.names, np.moveaxis(z, -1, 0), strict=True))
    law = candidate_parts(branch.model)[1]
    coefficient = dict(zip(branch.terms, target.oscillator.coefficients, strict=True))
    ratios = {}
    for term in branch.terms:
        smaller = candidate_name("+".join(x for x in branch.terms if x != term), law)
        ratios[smaller] = savage_dickey(target.priors, coefficient[term], scores, target.scales)
    return Product(RatiosContent(ratios))


Compute = Callable[[Branch, CellResult, int], Product]
KINDS: dict[str, tuple[str, Compute]] = {
    "widths": ("evidence/{}/importance", _compute_widths),
    "half": ("evidence/{}/importance", _compute_half),
    "noises": ("evidence/{}/importance", _compute_noises),
    "savage_dickey": ("posterior/{}/nuts", _compute_ratios),
}
"""By kind, the cell of the branch that it starts from, and the function that computes it."""
