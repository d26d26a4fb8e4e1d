"""Cells that say what a branch's evidence depends on: the priors' width, half the record, the posterior at zero."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from functools import partial

import numpy as np

from bayesdamp.inference.checks.forecast import carried_on
from bayesdamp.inference.deviation.single import first_half as first_half_of
from bayesdamp.inference.deviation.single import under
from bayesdamp.inference.evidence import Draws
from bayesdamp.inference.evidence.savage_dickey import savage_dickey
from bayesdamp.inference.evidence.sensitivity import (
    against_width,
    first_half,
    log_predictive,
    predict,
    under_priors,
)
from bayesdamp.inference.fit.mode import Mode, log_evidence_near
from bayesdamp.outcomes import following
from bayesdamp.pipeline.candidates.branch import Branch
from bayesdamp.pipeline.records.answering import likelihood_of
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

SOURCES = {
    "widths": "evidence/{}/importance",
    "half": "evidence/{}/importance",
    "noises": "evidence/{}/importance",
    "savage_dickey": "posterior/{}/nuts",
}
"""Which cell of the branch each starts from."""
CLOSE = ("half", "noises")
"""Those that need searches of their own."""
SHOWN = 1000
"""Samples of a prediction that are kept, at least, where there are as many."""


def sensitivity_cells(branch: Branch, found: Mapping[str, str]) -> dict[str, str]:
    """Return the names of a branch's cells and what their keys depend on.

    They are of the first repeat alone, and only where evidence is asked for. Where laws may hold approximately, what is
    coloured is the deviations' and κ's, and there is no other noise. Where what counts is a fit of this record and
    others together, the record is not looked at closely by itself. found: the branch's other cells, name to key.
    """
    if branch.repeat or not any(Place.of(n).kind == "evidence" for n in found):
        return {}
    study = branch.study
    joined = branch.spec.specimen in study.repeated and not study.posterior.samplers
    left_out = {
        *(CLOSE if joined else ()),
        *(["noises"] if len(study.noises) < 2 or likelihood_of(study) == "law" else []),
        *(["savage_dickey"] if len(branch.terms) < 2 else []),
    }
    sources = {kind: source.format(branch.path) for kind, source in SOURCES.items() if kind not in left_out}
    return {
        f"sensitivity/{branch.path}/{kind}": found[source]
        for kind, source in sources.items()
        if source in found
    }


def compute_sensitivity(branch: Branch, kind: str, seed: int) -> Product:
    """Compute one of these cells. Raises Refusal."""
    source = branch.store.read(SOURCES[kind].format(branch.path))
    if not source.arrays:
        none = "not applicable: no draws were kept; run with --fresh"
        raise Refusal(following(source.name, source.outcome) if source.outcome != OK else none)
    return _PRODUCTS[kind](branch, source, seed)


def _widths(branch: Branch, source: CellResult, seed: int) -> Product:
    y, log_weights = (source.arrays[n].astype(float) for n in ("y", "log_weights"))
    law, mode = branch.law, branch.density
    target = mode.likelihood.target

    def near(priors: Mapping[str, Prior]) -> Mode:
        return under_priors(mode, priors) if law is None else under(law, priors).mode

    found = asdict(against_width(target.priors, target.oscillator.coefficients, y, log_weights, near, seed))
    varied = found.pop("varied")
    return Product(WidthsContent(tuple(varied)), found)


def _half(branch: Branch, source: CellResult, seed: int) -> Product:
    law, mode, signal = branch.law, branch.density, branch.record.signal
    if law is None:
        t, half = signal.t, first_half(mode)
        carry = partial(carried_on, mode.likelihood, half=signal.t.size // 2)
    else:
        data, one = law.weighing.data, first_half_of(law)
        t, half = float(signal.t[0]) + data.t, one.mode
        carry = partial(law.carried_on, one, seed=seed)
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


def _ratios(branch: Branch, source: CellResult, seed: int) -> Product:
    target = branch.density.likelihood.target
    z = Draws.of(target, source.arrays["draws"]).z
    scores = dict(zip(target.names, np.moveaxis(z, -1, 0), strict=True))
    # The model without a term, in the order in which the study writes it.
    law = candidate_parts(branch.model)[1]
    pairs = {candidate_name("+".join(x for x in branch.terms if x != t), law): t for t in branch.terms}
    coefficient = dict(zip(branch.terms, branch.target.oscillator.coefficients, strict=True))
    return Product(
        RatiosContent(
            {m: savage_dickey(target.priors, coefficient[t], scores, target.scales) for m, t in pairs.items()}
        )
    )


def _noises(branch: Branch, source: CellResult, seed: int) -> Product:
    """Laplace's log evidence under each noise model in play, from the mode under the one that was chosen."""
    del source, seed
    mode = ModeContent.of(branch.store.read(f"mode/{branch.path}"))
    start, (whole, *_) = mode.values, mode.windows
    found: dict[str, UnderNoise] = {}
    for noise in branch.study.noises:
        if noise == branch.noise:
            found[noise] = UnderNoise(whole.log_evidence)
            continue
        try:
            target = branch.case.target(noise, branch.epsilon)
            mode = branch.case.mode(target, {Seed("under the chosen noise"): start}, thrifty=True)
            found[noise] = UnderNoise(log_evidence_near(mode.likelihood, mode.z))
        except Refusal as refusal:
            found[noise] = UnderNoise(-np.inf, str(refusal))
    return Product(NoisesContent(branch.noise, found))


_PRODUCTS = {"widths": _widths, "half": _half, "noises": _noises, "savage_dickey": _ratios}
