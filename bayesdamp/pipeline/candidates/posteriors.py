"""A branch's posteriors: their draws in a file, their summaries, and the damping against amplitude."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from bayesdamp.inference import diagnostics
from bayesdamp.inference.derived import CURVE_DRAWS, Motions, against_amplitude, derive, units
from bayesdamp.inference.samplers import Settings
from bayesdamp.interface.posterior import draw
from bayesdamp.numerics.weights import resample
from bayesdamp.physics.symbols import parameter_unit
from bayesdamp.pipeline.answering import verdict_of
from bayesdamp.pipeline.candidates.branch import Branch
from bayesdamp.pipeline.tasks import Product
from bayesdamp.store.contents import NO_DRAWS, PosteriorContent
from bayesdamp.store.files import write_bytes
from bayesdamp.types import OK, Ratio

CURVE = "equivalent_ratio"
LEVELS = np.array([0.025, 0.5, 0.975])
SPREAD = (np.arange(100) + 0.5) / 100
"""Levels of the quantiles that represent the draws of a curve, with equal weight."""
CURVE_POINTS = 25
SIZES = ("damping_deviation_size", "frequency_deviation_size")
"""In the file of draws: energy-weighted mean of the sizes of the deviations over the record."""
FAINTEST = 0.02
"""Least amplitude, as a share of the first, at which the damping is computed against amplitude."""


def compute_posterior(branch: Branch, sampler: str, seed: int) -> Product:
    """Draw with one sampler, write the draws to a file, and summarise them. Raises Refusal."""
    s, signal = branch.study.posterior, branch.record.signal
    posterior, u = draw(branch.fit, sampler, Settings(s.chains, s.warmup, s.draws, seed % 2**31))
    whole, law = posterior, branch.fit.law
    if law is not None:
        u = u.reshape(-1, u.shape[-1])
        sizes = np.stack([x.reshape(posterior.draws.shape[:2]) for x in law.sizes(u)], axis=-1)
        draws = np.concatenate([posterior.draws, sizes], axis=-1)
        whole = replace(posterior, names=(*posterior.names, *SIZES), draws=draws)
    folder = branch.store.folder
    file = folder / "posterior" / f"{branch.path.replace('/', '.')}.{sampler}.nc"
    write_bytes(file, diagnostics.saved(whole))
    motions = _motions(branch, {n: posterior.draws[..., i] for i, n in enumerate(posterior.names)})
    ratios: tuple[Ratio, ...] = ()
    if law is not None:
        verdict = verdict_of(branch.store, branch.spec.name, branch.repeat)
        amplitudes = tuple(r.amplitude for r in verdict.damping_ratio) if verdict else ()
        ratios = law.ratios(amplitudes, u, s.sensor)
    summary = dict(posterior.summaries)
    derived = derive(motions)
    # Draws without such a motion (no stable equilibrium, an escape) would bias the mean of the others.
    partial = {n: int(np.sum(~np.isfinite(v))) for n, v in derived.items() if not np.all(np.isfinite(v))}
    for n, v in derived.items():
        if n not in partial:
            summary[n] = diagnostics.summarise(v, posterior.ensembles, posterior.effective)
    unit = units(signal.unit)
    content = PosteriorContent(
        posterior=replace(
            posterior, draws=NO_DRAWS[0], log_likelihood=NO_DRAWS[1], stats={}, arrays={}, summaries={}
        ),
        units={
            n: unit.get(n) or parameter_unit(n, branch.restoring, signal.unit, signal.quantity)
            for n in summary
        },
        summary=summary,
        reference_amplitude=motions.amplitude,
        without=partial,
        file=file.relative_to(folder).as_posix(),
        ratios=ratios,
    )
    arrays = {"draws": posterior.draws, **_curves(branch, motions, u), **posterior.arrays}
    return Product(content, arrays, posterior.outcome, posterior.seconds)


def weighted_curves(branch: Branch, seed: int) -> dict[str, np.ndarray]:
    """Return the curves of a candidate that was not sampled, from the weighted draws of its evidence.

    They are those of a posterior's cell; empty where there are no importance draws to be trusted.
    """
    cell = branch.store.find(f"evidence/{branch.path}/importance")
    if cell is None or cell.outcome != OK or "log_weights" not in cell.arrays:
        return {}
    rng = np.random.default_rng(seed)
    chosen = resample(cell.arrays["log_weights"].astype(float), CURVE_DRAWS, rng)
    z, target = cell.arrays["y"].astype(float)[chosen], branch.fit.engine[0]
    u = NO_DRAWS[0] if branch.fit.law is None else branch.fit.law.with_deviations(z, seed)
    return _curves(branch, _motions(branch, target.values(z)), u)


def _motions(branch: Branch, inferred: Mapping[str, np.ndarray]) -> Motions:
    """Return the motions of draws under exact laws."""
    (target, _), record = branch.fit.engine, branch.record
    values = {**target.known, **inferred}
    return Motions(
        target.oscillator, values, record.features.rest, record.content.scales.amplitude, branch.spec.inertia
    )


def _curves(branch: Branch, motions: Motions, u: np.ndarray) -> dict[str, np.ndarray]:
    """Return decrement and equivalent ratio over a record's amplitudes, (m,), without those that have no motion.

    u: draws with their deviations, (n, K), where laws may hold approximately.
    """
    record, law = branch.record.features, branch.fit.law
    least = max(min(record.amplitude, record.final_amplitude), FAINTEST * record.amplitude)
    grid = np.geomspace(least, record.amplitude, CURVE_POINTS)
    levels = (*LEVELS, *SPREAD)
    curves = against_amplitude(motions, grid, levels)
    if law is not None:
        few = u[:: max(1, len(u) // CURVE_DRAWS)]
        drawn = law.ratio_draws(grid, few, branch.study.posterior.sensor)
        finite = np.all(np.isfinite(drawn), axis=0)
        ratio = np.full((len(levels), grid.size), np.nan)
        if finite.any():
            ratio[:, finite] = np.quantile(drawn[:, finite], levels, axis=0)
        # The ratio of a cycle's decrement to its damping ratio follows from the restoring law alone.
        middle = list(LEVELS).index(0.5)
        curves = {n: ratio * (c[middle] / curves[CURVE][middle]) for n, c in curves.items()}
    whole = np.all([np.all(np.isfinite(c), axis=0) for c in curves.values()], axis=0)
    band = {f"curve/{n}": c[: len(LEVELS), whole] for n, c in curves.items()}
    return {"amplitudes": grid[whole], **band, f"spread/{CURVE}": curves[CURVE][len(LEVELS) :, whole]}
