"""Compute how sensitive a candidate's evidence is: to the widths of priors, to half of the record, to the noise model.

A further task computes the log Bayes factor of each model with one term less against the candidate, by the
Savage-Dickey ratio.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict
from functools import partial

import numpy as np

from bayesdamp.inference.checks import predict_second_half
from bayesdamp.inference.deviation.single import first_half as first_half_of, replace_priors
from bayesdamp.inference.evidence import Draws
from bayesdamp.inference.mode import Mode, log_evidence_near
from bayesdamp.inference.sensitivity import (
    evidence_by_prior_width,
    first_half,
    log_predictive,
    predict_from_half,
    savage_dickey,
    under_priors,
)
from bayesdamp.outcomes import following
from bayesdamp.pipeline.candidates.candidate import StudyCandidate
from bayesdamp.pipeline.tasks import Product
from bayesdamp.priors import Prior
from bayesdamp.store import TaskResult
from bayesdamp.store.contents import (
    EvidenceContent,
    HalfContent,
    ModeContent,
    NoisesContent,
    RatiosContent,
    UnderNoise,
    WidthsContent,
)
from bayesdamp.store.results import TaskName
from bayesdamp.types import OK, Refusal, candidate_name, candidate_parts

STORED_SAMPLES = 1000
"""A prediction of more samples is thinned before it is stored, to at least this number of samples."""


def sensitivity_sources(candidate: StudyCandidate, keys: Mapping[str, str]) -> dict[str, str]:
    """Return the names of a candidate's sensitivity tasks, with the key of the task that each starts from.

    They exist only for the first repeat, and only if the study asks for evidence. Fewer terms (`savage_dickey`) are
    tested only in a sum of two or more, other noise models only if the study names several and the laws hold exactly.

    Parameters
    ----------
    candidate
        The candidate.
    keys
        Keys of the candidate's other tasks, by name.
    """
    if candidate.repeat or not any(TaskName.of(n).kind == "evidence" for n in keys):
        return {}
    study = candidate.study
    left_out = {
        *(["noises"] if len(study.noises) < 2 or study.likelihood == "law" else []),
        *(["savage_dickey"] if len(candidate.terms) < 2 else []),
    }
    sources = {kind: source.format(candidate.path) for kind, (source, _) in SENSITIVITIES.items()}
    return {
        f"sensitivity/{candidate.path}/{kind}": keys[source]
        for kind, source in sources.items()
        if kind not in left_out and source in keys
    }


def compute_sensitivity(candidate: StudyCandidate, kind: str, seed: int) -> Product:
    """Compute one of the sensitivity tasks: kind "widths", "half", "noises" or "savage_dickey".

    `seed` is that of new draws. Raises Refusal if the task that it starts from has stored no arrays.
    """
    source_name, compute = SENSITIVITIES[kind]
    source = candidate.store.read(source_name.format(candidate.path))
    if not source.arrays:
        reason = "not applicable: the draws for this are not stored; run the study again with --fresh"
        raise Refusal(following(source.name, source.outcome) if source.outcome != OK else reason)
    return compute(candidate, source, seed)


def _compute_widths(candidate: StudyCandidate, source: TaskResult, seed: int) -> Product:
    """Return the log evidence (nats) with the priors of all damping coefficients scaled by each of several factors.

    The factors are `PRIOR_FACTORS`. The evidence is from reweighted draws, or new ones (see `evidence_by_prior_width`);
    the arrays are the fields of `Widths`.
    """
    y, log_weights = (source.arrays[n].astype(float) for n in ("y", "log_weights"))
    law, (target, mode) = candidate.fit.law, candidate.fit.engine

    def fit_under(priors: Mapping[str, Prior]) -> Mode:
        return under_priors(mode, priors) if law is None else replace_priors(law, priors).mode

    coefficients = target.oscillator.coefficients
    widths = asdict(evidence_by_prior_width(target.priors, coefficients, y, log_weights, fit_under, seed))
    varied = widths.pop("varied")
    return Product(WidthsContent(tuple(varied)), widths)


def _compute_half(candidate: StudyCandidate, source: TaskResult, seed: int) -> Product:
    """Return the evidence of the first half of the record, and how well the fit to this half predicts the second.

    The content is a `HalfContent`. The arrays are `t`, the times (s) of the second half, thinned, and `error` and `sd`,
    the error of the prediction there and its expected standard deviation, in the unit of the record.
    """
    law, (_, mode), signal = candidate.fit.law, candidate.fit.engine, candidate.record.signal
    if law is None:
        t, half = signal.t, first_half(mode)
        carry = partial(predict_second_half, mode.likelihood, half=signal.t.size // 2)
    else:
        data, single = law.comparison.data, first_half_of(law)
        t, half = float(signal.t[0]) + data.t, single.mode
        carry = partial(law.predict_second_half, single, seed=seed)
    evidence, ahead = predict_from_half(candidate.model, half, carry, seed)
    whole = EvidenceContent.of(source).evidence
    assert whole is not None  # a source with draws has evidence
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
    every = max(1, later.size // STORED_SAMPLES)
    return Product(content, {"t": later[::every], "error": ahead.error[::every], "sd": ahead.sd[::every]})


def _compute_noises(candidate: StudyCandidate, source: TaskResult, seed: int) -> Product:
    """Return Laplace's log evidence (nats) under each noise model of the study.

    The content is a `NoisesContent`, without arrays; source and seed are not used. Each search for a mode starts at the
    mode under the chosen noise model. If a search finds none, the log evidence is −∞, with the reason as outcome.
    """
    del source, seed
    content = ModeContent.of(candidate.store.read(f"mode/{candidate.path}"))
    start, (whole, *_) = content.values, content.windows
    evidence: dict[str, UnderNoise] = {}
    for noise in candidate.study.noises:
        if noise == candidate.noise:
            evidence[noise] = UnderNoise(whole.log_evidence)
            continue
        try:
            mode = candidate.case.mode(noise, candidate.epsilon, [start], draws=0, thrifty=True)
            evidence[noise] = UnderNoise(log_evidence_near(mode.likelihood, mode.z))
        except Refusal as refusal:
            evidence[noise] = UnderNoise(-np.inf, str(refusal))
    return Product(NoisesContent(candidate.noise, evidence))


def _compute_ratios(candidate: StudyCandidate, source: TaskResult, seed: int) -> Product:
    """Return the log Bayes factor (nats) of each model with one damping term less against the candidate.

    The content is a `RatiosContent`; seed is not used. Each is a Savage-Dickey ratio: log posterior density minus log
    prior density of the term's coefficient at 0. A positive value favours the smaller model.
    """
    del seed
    target, _ = candidate.fit.engine
    z = Draws.of(target, source.arrays["draws"]).z
    scores = dict(zip(target.names, np.moveaxis(z, -1, 0), strict=True))
    law = candidate_parts(candidate.model)[1]
    coefficient = dict(zip(candidate.terms, target.oscillator.coefficients, strict=True))
    ratios = {}
    for term in candidate.terms:
        smaller = candidate_name("+".join(x for x in candidate.terms if x != term), law)
        ratios[smaller] = savage_dickey(target.priors, coefficient[term], scores, target.scales)
    return Product(RatiosContent(ratios))


Compute = Callable[[StudyCandidate, TaskResult, int], Product]
SENSITIVITIES: dict[str, tuple[str, Compute]] = {
    "widths": ("evidence/{}/importance", _compute_widths),
    "half": ("evidence/{}/importance", _compute_half),
    "noises": ("evidence/{}/importance", _compute_noises),
    "savage_dickey": ("posterior/{}/nuts", _compute_ratios),
}
"""By kind of sensitivity: the task of the candidate that it starts from, and the function that computes it."""
