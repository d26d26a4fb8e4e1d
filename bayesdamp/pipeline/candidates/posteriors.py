"""A branch's posteriors: their draws in a file, their summaries, and the damping against amplitude."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from bayesdamp.inference.checks import diagnostics
from bayesdamp.inference.curves.derived import CURVE_DRAWS, Motions, against_amplitude, derive, units
from bayesdamp.inference.curves.weighted import resampled
from bayesdamp.inference.samplers import SAMPLERS, Settings
from bayesdamp.physics.symbols import parameter_unit
from bayesdamp.pipeline.candidates.branch import Branch
from bayesdamp.pipeline.records.answering import verdict_of
from bayesdamp.pipeline.tasks import Product
from bayesdamp.store.contents import NO_DRAWS, PosteriorContent
from bayesdamp.store.files import write_bytes
from bayesdamp.types import OK, Posterior, Ratio

CURVE = "equivalent_ratio"
LEVELS = np.array([0.025, 0.5, 0.975])
SPREAD = (np.arange(100) + 0.5) / 100
"""Levels of the quantiles that stand for the draws of a curve, with equal weight."""
CURVE_POINTS = 25
SIZES = ("damping_deviation_size", "frequency_deviation_size")
"""In the file of draws: energy-weighted mean of the sizes of the deviations over the record."""
FAINTEST = 0.02
"""Least amplitude, as a share of the first, at which a damping is given against amplitude."""


def compute_posterior(branch: Branch, sampler: str, seed: int) -> Product:
    """Draw with one sampler: what the draws say. Raises Refusal."""
    s = branch.study.posterior
    settings = Settings(s.chains, s.warmup, s.draws, seed % 2**31)
    law, mode = branch.law, branch.density
    found = SAMPLERS.get(sampler).summarised(mode.likelihood.target, mode, settings)
    whole, u = found, None
    if law is not None:
        found, u = law.completed(found, settings.seed)
        u = u.reshape(-1, u.shape[-1])
        sizes = np.stack([x.reshape(found.draws.shape[:2]) for x in law.sizes(u)], axis=-1)
        draws = np.concatenate([found.draws, sizes], axis=-1)
        whole = replace(found, names=(*found.names, *SIZES), draws=draws)
    folder = branch.store.folder
    file = folder / "posterior" / f"{branch.path.replace('/', '.')}.{sampler}.nc"
    write_bytes(file, diagnostics.saved(whole))
    motions = _motions(branch, {n: found.draws[..., i] for i, n in enumerate(found.names)})
    ratios: tuple[Ratio, ...] = ()
    if law is not None and u is not None:
        verdict = verdict_of(branch.store, branch.spec.name, branch.repeat)
        amplitudes = tuple(r.amplitude for r in verdict.damping_ratio) if verdict else ()
        ratios = law.ratios(amplitudes, u, s.sensor)
    content = replace(
        _content(branch, found, motions),
        posterior=replace(
            found, draws=NO_DRAWS[0], log_likelihood=NO_DRAWS[1], stats={}, arrays={}, summaries={}
        ),
        file=file.relative_to(folder).as_posix(),
        ratios=ratios,
    )
    arrays = {"draws": found.draws, **_curves(branch, motions, u), **found.arrays}
    return Product(content, arrays, found.outcome, found.seconds)


def weighted_curves(branch: Branch, seed: int) -> dict[str, np.ndarray]:
    """What a posterior's cell has of its curves, from the draws of the evidence of a candidate that was not sampled;
    empty where it has no importance draws to be trusted."""
    cell = branch.store.find(f"evidence/{branch.path}/importance")
    if cell is None or cell.outcome != OK or "log_weights" not in cell.arrays:
        return {}
    rng = np.random.default_rng(seed)
    chosen = resampled(cell.arrays["log_weights"].astype(float), CURVE_DRAWS, rng)
    z, target = cell.arrays["y"].astype(float)[chosen], branch.density.likelihood.target
    u = None if branch.law is None else branch.law.with_deviations(z, seed)
    return _curves(branch, _motions(branch, target.values(z)), u)


def _content(branch: Branch, found: Posterior, motions: Motions) -> PosteriorContent:
    """Summaries of the parameters and of what follows from them, with units."""
    summary = dict(found.summaries)
    derived = derive(motions)
    # A draw without such a motion (no stable equilibrium, an escape) leaves no honest mean of the others.
    partial = {n: int(np.sum(~np.isfinite(v))) for n, v in derived.items() if not np.all(np.isfinite(v))}
    for n, v in derived.items():
        if n not in partial:
            summary[n] = diagnostics.summarise(v, found.ensembles, found.effective)
    signal, law = branch.record.signal, branch.restoring
    unit = units(signal.unit)
    return PosteriorContent(
        units={n: unit.get(n) or parameter_unit(n, law, signal.unit, signal.quantity) for n in summary},
        summary=summary,
        reference_amplitude=motions.amplitude,
        without=partial,
    )


def _motions(branch: Branch, inferred: Mapping[str, np.ndarray]) -> Motions:
    """Draws under the laws alone."""
    target, record = branch.density.likelihood.target, branch.record
    values = {**target.known, **inferred}
    return Motions(
        target.oscillator, values, record.seen.rest, record.reference.amplitude, branch.spec.inertia
    )


def _curves(branch: Branch, motions: Motions, u: np.ndarray | None) -> dict[str, np.ndarray]:
    """Decrement and equivalent ratio over a record's amplitudes, (m,); those that have no motion are left out.

    u: draws with their deviations, (n, K), where laws may hold approximately.
    """
    seen, law = branch.record.seen, branch.law
    least = max(min(seen.amplitude, seen.final_amplitude), FAINTEST * seen.amplitude)
    grid = np.geomspace(least, seen.amplitude, CURVE_POINTS)
    found = against_amplitude(motions, grid, (*LEVELS, *SPREAD))
    if law is not None and u is not None:
        few = u[:: max(1, len(u) // CURVE_DRAWS)]
        drawn = law.ratio_draws(grid, few, branch.study.posterior.sensor)
        there = np.all(np.isfinite(drawn), axis=0)
        ratio = np.full((len(LEVELS) + len(SPREAD), grid.size), np.nan)
        if there.any():
            ratio[:, there] = np.quantile(drawn[:, there], (*LEVELS, *SPREAD), axis=0)
        # A cycle's decrement is so many times its damping ratio, by the restoring law alone.
        middle = list(LEVELS).index(0.5)
        found = {n: ratio * (c[middle] / found[CURVE][middle]) for n, c in found.items()}
    whole = np.all([np.all(np.isfinite(c), axis=0) for c in found.values()], axis=0)
    band = {f"curve/{n}": c[: len(LEVELS), whole] for n, c in found.items()}
    return {"amplitudes": grid[whole], **band, f"spread/{CURVE}": found[CURVE][len(LEVELS) :, whole]}
