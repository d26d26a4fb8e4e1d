"""A branch's posteriors: their draws in a file, their summaries, and the damping against amplitude."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from bayesdamp.inference.checks import diagnostics
from bayesdamp.inference.curves.derived import Motions, against_amplitude, derive, units
from bayesdamp.inference.samplers import SAMPLERS, Settings
from bayesdamp.physics.units import parameter_unit
from bayesdamp.pipeline.candidates.branch import Branch
from bayesdamp.records.oscillation.features import Features
from bayesdamp.store import CellResult
from bayesdamp.store.contents.posteriors import SAID, PosteriorContent
from bayesdamp.store.files import write_bytes
from bayesdamp.store.places import Place
from bayesdamp.types import Posterior, Refusal

CURVE = "equivalent_ratio"
LEVELS = np.array([0.025, 0.5, 0.975])
SPREAD = (np.arange(100) + 0.5) / 100
"""Levels of the quantiles that stand for the draws of a curve, with equal weight."""
CURVE_POINTS = 25
FAINTEST = 0.02
"""Least amplitude, as a share of the first, at which a damping is given against amplitude."""


def compute_posterior(branch: Branch, name: str, key: str, seed: int) -> None:
    """Draw with one sampler, and keep what the draws say."""
    sampler, s = Place.of(name).method, branch.study.posterior
    plugin = SAMPLERS.get(sampler)
    settings = Settings(s.chains, s.warmup, s.draws, seed % 2**31)
    try:
        found = diagnostics.summarised(plugin.sample(branch.target, branch.restored_mode, settings))
    except Refusal as refusal:
        branch.store.write(CellResult(name, key, outcome=str(refusal)))
        return
    folder = branch.store.folder
    file = folder / "posterior" / f"{branch.path.replace('/', '.')}.{sampler}.nc"
    save_whole(found, file)
    motions = _motions(branch, found)
    content = replace(
        _content(branch, found, motions),
        diagnostics=found.diagnostics,
        file=file.relative_to(folder).as_posix(),
        **{k: getattr(found, k) for k in SAID},
    )
    arrays = {"draws": found.draws, **curves(motions, branch.record.seen), **found.arrays}
    branch.store.write(CellResult(name, key, content.meta(), arrays, found.outcome, found.seconds))


def _content(branch: Branch, found: Posterior, motions: Motions) -> PosteriorContent:
    """Summaries of the parameters and of what follows from them, with units."""
    summary = dict(found.summary)
    derived = derive(motions)
    # A draw without such a motion (no stable equilibrium, an escape) leaves no honest mean of the others.
    partial = {n: int(np.sum(~np.isfinite(v))) for n, v in derived.items() if not np.all(np.isfinite(v))}
    for n, v in derived.items():
        if n not in partial:
            summary[n] = diagnostics.summarise(v, found.ensembles, found.effective)
    signal, law = branch.record.signal, branch.system.restoring
    unit = units(signal.unit)
    return PosteriorContent(
        names=tuple(map(str, found.names)),
        units={n: unit.get(n) or parameter_unit(n, law, signal.unit, signal.quantity) for n in summary},
        summary=summary,
        reference_amplitude=motions.amplitude,
        without=partial,
    )


def _motions(branch: Branch, found: Posterior) -> Motions:
    inferred = {n: found.draws[..., i] for i, n in enumerate(found.names)}
    values = {**branch.target.known, **inferred}
    amplitude = branch.record.reference.amplitude
    return Motions(branch.target.oscillator, values, branch.record.seen.rest, amplitude, branch.spec.inertia)


def amplitude_grid(seen: Features) -> np.ndarray:
    """Amplitudes from the record's last to its first, shape (m,)."""
    first, last = seen.amplitude, seen.final_amplitude
    return np.geomspace(max(min(first, last), FAINTEST * first), first, CURVE_POINTS)


def curves(motions: Motions, seen: Features) -> dict[str, np.ndarray]:
    """Decrement and equivalent ratio over a record's amplitudes, (m,); those that have no motion are left out."""
    grid = amplitude_grid(seen)
    found = against_amplitude(motions, grid, (*LEVELS, *SPREAD))
    whole = np.all([np.all(np.isfinite(c), axis=0) for c in found.values()], axis=0)
    band = {f"curve/{n}": c[: len(LEVELS), whole] for n, c in found.items()}
    return {"amplitudes": grid[whole], **band, f"spread/{CURVE}": found[CURVE][len(LEVELS) :, whole]}


def save_whole(posterior: Posterior, file: Path) -> None:
    """Write a posterior's netCDF in one step, so that a kill leaves no part of it."""
    write_bytes(file, diagnostics.saved(posterior))
