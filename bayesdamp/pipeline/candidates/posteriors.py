"""Sample the posterior of a candidate, and compute its summaries and its damping against amplitude."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from bayesdamp.inference import diagnostics
from bayesdamp.inference.derived import (
    CURVE_DRAWS,
    Motions,
    curves_against_amplitude,
    derive_quantities,
    units,
)
from bayesdamp.inference.samplers import Settings
from bayesdamp.interface.posterior import draw
from bayesdamp.numerics.weights import resample
from bayesdamp.physics.symbols import parameter_unit
from bayesdamp.pipeline.answering import stored_answer
from bayesdamp.pipeline.candidates.candidate import StudyCandidate
from bayesdamp.pipeline.tasks import Product
from bayesdamp.store.contents import NO_DRAWS, PosteriorContent
from bayesdamp.store.files import write_bytes
from bayesdamp.types import OK, Ratio

CURVE = "equivalent_ratio"
"""Name of the curve of the equivalent damping ratio against amplitude in stored arrays."""
QUANTILE_LEVELS = np.array([0.025, 0.5, 0.975])
"""Levels of the quantiles of a curve that are stored and drawn: the ends of the 95 % interval, and the median."""
STORED_LEVELS = (np.arange(100) + 0.5) / 100
"""Levels of the 100 quantiles that are stored at each point of a curve. They represent the draws by 100 values of equal
weight."""
CURVE_POINTS = 25
"""Number of amplitudes, equally spaced in their logarithm, at which the damping against amplitude is computed."""
SIZES = ("damping_deviation_size", "frequency_deviation_size")
"""Names of two variables in the file of draws: the sizes of the deviations of damping and frequency from their laws,
relative to the laws, as energy-weighted means over the record of |deviation − its mean|."""
SMALLEST_AMPLITUDE = 0.02
"""Smallest amplitude of the curves as a fraction of the first amplitude (conventional)."""


def compute_posterior(candidate: StudyCandidate, sampler: str, seed: int) -> Product:
    """Draw with one sampler, write the draws to a file (netCDF), and summarise them.

    The content is a `PosteriorContent` with the summaries of parameters and derived quantities; the arrays are the
    `draws`, (chain, draw, parameter), in the units of the parameters, and the curves of `_curves`.

    Raises Refusal if there is no fit, or the sampler cannot work on it.
    """
    s, signal = candidate.study.posterior, candidate.record.signal
    posterior, u = draw(candidate.fit, sampler, Settings(s.chains, s.warmup, s.draws, seed % 2**31))
    whole, law = posterior, candidate.fit.law
    if law is not None:
        u = u.reshape(-1, u.shape[-1])
        sizes = np.stack([x.reshape(posterior.draws.shape[:2]) for x in law.sizes(u)], axis=-1)
        draws = np.concatenate([posterior.draws, sizes], axis=-1)
        whole = replace(posterior, names=(*posterior.names, *SIZES), draws=draws)
    folder = candidate.store.folder
    file = folder / "posterior" / f"{candidate.path.replace('/', '.')}.{sampler}.nc"
    write_bytes(file, diagnostics.to_netcdf(whole))
    motions = _motions(candidate, {n: posterior.draws[..., i] for i, n in enumerate(posterior.names)})
    ratios: tuple[Ratio, ...] = ()
    if law is not None:
        answer = stored_answer(candidate.record)
        amplitudes = tuple(r.amplitude for r in answer.verdict.damping_ratio) if answer else ()
        ratios = law.ratios(amplitudes, u, s.sensor)
    summary = dict(posterior.summaries)
    derived = derive_quantities(motions)
    # A quantity that some draws do not have (no stable equilibrium, an escape) gets no summary: it would be biased.
    partial = {n: int(np.sum(~np.isfinite(v))) for n, v in derived.items() if not np.all(np.isfinite(v))}
    for n, v in derived.items():
        if n not in partial:
            summary[n] = diagnostics.summarise(v, posterior.ensembles)
    unit = units(signal.unit)
    content = PosteriorContent(
        posterior=replace(posterior, draws=NO_DRAWS[0], log_likelihood=NO_DRAWS[1], stats={}, summaries={}),
        units={
            n: unit.get(n) or parameter_unit(n, candidate.restoring, signal.unit, signal.quantity)
            for n in summary
        },
        summary=summary,
        reference_amplitude=motions.amplitude,
        without=partial,
        file=file.relative_to(folder).as_posix(),
        ratios=ratios,
    )
    arrays = {"draws": posterior.draws, **_curves(candidate, motions, u)}
    return Product(content, arrays, posterior.outcome, posterior.seconds)


def weighted_curves(candidate: StudyCandidate, seed: int) -> dict[str, np.ndarray]:
    """Return the curves of a candidate that was not sampled, from the weighted draws of its importance sampling.

    The arrays are those of `_curves`, with quantiles of resampled draws of equal weight; there are none if the
    candidate has no reliable importance draws.
    """
    result = candidate.store.find(f"evidence/{candidate.path}/importance")
    if result is None or result.outcome != OK or "log_weights" not in result.arrays:
        return {}
    rng = np.random.default_rng(seed)
    chosen = resample(result.arrays["log_weights"].astype(float), CURVE_DRAWS, rng)
    z, target = result.arrays["y"].astype(float)[chosen], candidate.fit.engine[0]
    u = NO_DRAWS[0] if candidate.fit.law is None else candidate.fit.law.with_deviations(z, seed)
    return _curves(candidate, _motions(candidate, target.values(z)), u)


def _motions(candidate: StudyCandidate, inferred: Mapping[str, np.ndarray]) -> Motions:
    """Return the motions of draws under exact laws. inferred: draws by parameter, all of the same shape."""
    (target, _), record = candidate.fit.engine, candidate.record
    values = {**target.known, **inferred}
    return Motions(
        target.oscillator,
        values,
        record.features.rest,
        record.content.scales.amplitude,
        candidate.spec.inertia,
    )


def _curves(candidate: StudyCandidate, motions: Motions, u: np.ndarray) -> dict[str, np.ndarray]:
    """Return the curves of log decrement and equivalent damping ratio over the record's range of amplitudes.

    The arrays are `amplitudes`, (a,), ascending, in rad or m; `curve/NAME`, (3, a), the 2.5, 50 and 97.5 % quantiles of
    `log_decrement` and `equivalent_ratio`; and `spread/equivalent_ratio`, (100, a), quantiles at `STORED_LEVELS`.
    Amplitudes at which a curve is not defined are left out. u: draws with their deviations, (n, K); not used if the fit
    has exact laws.
    """
    record, law = candidate.record.features, candidate.fit.law
    least = max(min(record.amplitude, record.final_amplitude), SMALLEST_AMPLITUDE * record.amplitude)
    grid = np.geomspace(least, record.amplitude, CURVE_POINTS)
    levels = (*QUANTILE_LEVELS, *STORED_LEVELS)
    curves = curves_against_amplitude(motions, grid, levels)
    if law is not None:
        few = u[:: max(1, len(u) // CURVE_DRAWS)]
        drawn = law.ratio_draws(grid, few, candidate.study.posterior.sensor)
        finite = np.all(np.isfinite(drawn), axis=0)
        ratio = np.full((len(levels), grid.size), np.nan)
        if finite.any():
            ratio[:, finite] = np.quantile(drawn[:, finite], levels, axis=0)
        # The ratio of a cycle's decrement to its damping ratio follows from the restoring law alone.
        middle = list(QUANTILE_LEVELS).index(0.5)
        curves = {n: ratio * (c[middle] / curves[CURVE][middle]) for n, c in curves.items()}
    whole = np.all([np.all(np.isfinite(c), axis=0) for c in curves.values()], axis=0)
    band = {f"curve/{n}": c[: len(QUANTILE_LEVELS), whole] for n, c in curves.items()}
    return {
        "amplitudes": grid[whole],
        **band,
        f"spread/{CURVE}": curves[CURVE][len(QUANTILE_LEVELS) :, whole],
    }
