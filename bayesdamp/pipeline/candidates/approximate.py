"""A branch's posteriors and evidence where its study has laws hold approximately: as Python draws and weighs them."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from bayesdamp.config import Study
from bayesdamp.inference.approximate.chains import Chains, by_emcee, by_nuts
from bayesdamp.inference.approximate.evidence import by_bridge, by_importance, by_nested, linear
from bayesdamp.inference.approximate.law import Approximate
from bayesdamp.inference.approximate.runs import summaries_of
from bayesdamp.inference.checks import diagnostics
from bayesdamp.inference.curves.derived import CURVE_DRAWS, Motions, against_amplitude, derive, units
from bayesdamp.inference.curves.weighted import resampled
from bayesdamp.inference.deviation.sampled.marginal import marginal_of
from bayesdamp.inference.samplers import Settings
from bayesdamp.outcomes import Status
from bayesdamp.physics.units import parameter_unit
from bayesdamp.pipeline.candidates.branch import Branch
from bayesdamp.pipeline.candidates.posteriors import CURVE, LEVELS, SPREAD, amplitude_grid, save_whole
from bayesdamp.pipeline.candidates.weighing import called, silent
from bayesdamp.pipeline.records.answering import law_of, verdict_of
from bayesdamp.pipeline.stored_laws import put_together
from bayesdamp.store import CellResult
from bayesdamp.store.contents.evidence import EvidenceContent
from bayesdamp.store.contents.posteriors import DrawnRatio, PosteriorContent
from bayesdamp.store.places import Place
from bayesdamp.types import OK, Evidence, Posterior, Refusal

SAMPLERS: Mapping[str, Callable[[Approximate, Settings], Chains]] = {
    "nuts": by_nuts,
    "emcee": by_emcee,
}
LINEAR, IMPORTANCE, BRIDGE, NESTED = "laplace", "importance", "bridge", "nested"
"""The methods of evidence that integrate deviations out."""
WARMUP = 50
"""Draws of a chain that are left out at most: chains start in the linear posterior, and nothing is adapted."""
NOT_DRAWN = Status.NOT_APPLICABLE.because('{} takes laws to hold exactly; under deviation "law" give {}')
SIZES = ("damping_deviation_size", "frequency_deviation_size")
"""In the file of draws: energy-weighted mean of the sizes of the deviations over the record."""


def under_law(study: Study) -> bool:
    """Whether what a study samples may hold approximately. Under "auto" its answer alone does."""
    return study.posterior.deviation == "law"


def likelihood_of(study: Study) -> str:
    """What the tables say of it: "law" or "none"."""
    return "law" if under_law(study) else "none"


def law_on(branch: Branch) -> Approximate:
    """The candidate as the answer's search left it. Raises Refusal where there is none."""
    found = law_of(branch.store, branch.spec.name, branch.repeat, "+".join(branch.terms), branch.restoring)
    single = put_together(branch.record.signal, branch.restoring, found)
    return Approximate(single, branch.study.posterior.sensor)


def compute_posterior(branch: Branch, name: str, key: str, seed: int) -> None:
    """Draw with one sampler, and keep what the draws say."""
    sampler, s = Place.of(name).method, branch.study.posterior
    try:
        if sampler not in SAMPLERS:
            raise Refusal(NOT_DRAWN.format(sampler, " or ".join(SAMPLERS)))
        law = law_on(branch)
        drawn, seconds = _drawn(
            law, sampler, Settings(s.chains, min(s.warmup, WARMUP), s.draws, seed % 2**31)
        )
    except Refusal as refusal:
        branch.store.write(CellResult(name, key, outcome=str(refusal)))
        return
    values = law.values(drawn.u)
    summary: dict[str, Any] = summaries_of(law, values, drawn.ensembles)
    outcome = diagnostics.verdict(summary) if drawn.outcome == "ok" else drawn.outcome
    flat = drawn.u.reshape(-1, drawn.u.shape[-1])
    folder = branch.store.folder
    file = folder / "posterior" / f"{branch.path.replace('/', '.')}.{sampler}.nc"
    sizes = [x.reshape(values.shape[:2]) for x in law.sizes(flat)]
    names = (*law.names, *SIZES)
    whole = np.concatenate([values, np.stack(sizes, axis=-1)], axis=-1)
    save_whole(Posterior(sampler, names, whole, drawn.log_likelihood, drawn.stats), file)
    motions = _motions(branch, law, values)
    summary, partial = _with_derived(summary, motions, drawn.ensembles)
    signal, verdict = branch.record.signal, verdict_of(branch.store, branch.spec.name, branch.repeat)
    amplitudes = tuple(r.amplitude for r in verdict.damping_ratio) if verdict else ()
    unit = units(signal.unit)
    content = PosteriorContent(
        names=law.names,
        units={
            n: unit.get(n) or parameter_unit(n, branch.restoring, signal.unit, signal.quantity)
            for n in summary
        },
        summary=summary,
        reference_amplitude=branch.record.reference.amplitude,
        without=partial,
        file=file.relative_to(folder).as_posix(),
        ratios=tuple(DrawnRatio(**asdict(r)) for r in law.ratios(amplitudes, flat)),
        divergences=drawn.divergences,
        evaluations=drawn.evaluations,
        ensembles=drawn.ensembles,
    )
    arrays = {"draws": values, **_curves(law, motions, amplitude_grid(branch.record.seen), flat)}
    branch.store.write(CellResult(name, key, content.meta(), arrays, outcome, seconds))


def weighted_curves(branch: Branch, seed: int) -> dict[str, np.ndarray]:
    """`weighted.weighted_curves` of draws that are each given their deviations."""
    cell = branch.store.find(f"evidence/{branch.path}/{IMPORTANCE}")
    if cell is None or cell.outcome != OK or "log_weights" not in cell.arrays:
        return {}
    law, rng = law_on(branch), np.random.default_rng(seed)
    chosen = resampled(cell.arrays["log_weights"].astype(float), CURVE_DRAWS, rng)
    target = marginal_of(law.single.weighing, law.single.result)
    u = target.with_deviations(cell.arrays["y"].astype(float)[chosen], rng)
    motions = _motions(branch, law, law.values(u))
    return _curves(law, motions, amplitude_grid(branch.record.seen), u)


def compute_evidence(branch: Branch, name: str, key: str, seed: int) -> None:
    """Compute one method's evidence; a referee that is not needed says so, and so does a method that takes laws to hold
    exactly."""
    method = Place.of(name).method
    try:
        if method not in (LINEAR, IMPORTANCE, BRIDGE, NESTED):
            raise Refusal(NOT_DRAWN.format(method, f"{IMPORTANCE}, {BRIDGE} or {NESTED}"))
        if not called(branch, method):
            branch.store.write(CellResult(name, key, silent(branch, method).meta()))
            return
        one = _weighed(branch, law_on(branch), method, seed)
    except Refusal as refusal:
        branch.store.write(CellResult(name, key, outcome=str(refusal)))
        return
    content = EvidenceContent.holding(one)
    arrays = one.arrays if branch.repeat == 0 else {}  # for what is asked of the first repeat alone
    branch.store.write(CellResult(name, key, content.meta(), arrays, one.outcome, one.seconds))


def _weighed(branch: Branch, law: Approximate, method: str, seed: int) -> Evidence:
    if method == LINEAR:
        return linear(law, branch.model, method)
    if method == IMPORTANCE:
        return by_importance(law, branch.model, method, seed)
    if method == NESTED:
        return by_nested(law, branch.model, method, seed)
    draws, outcome, s = None, "", branch.study.posterior
    if "nuts" in s.samplers:
        cell = branch.store.read(f"posterior/{branch.path}/nuts")
        draws, outcome = cell.arrays.get("draws"), cell.outcome
    if draws is None:
        drawn, _ = _drawn(law, "nuts", Settings(s.chains, WARMUP, s.draws, seed % 2**31))
        draws = law.values(drawn.u)
        said = diagnostics.verdict(summaries_of(law, draws, drawn.ensembles))
        outcome = said if drawn.outcome == "ok" else drawn.outcome
    return by_bridge(law, branch.model, method, draws, outcome, seed)


def _drawn(law: Approximate, sampler: str, asked: Settings) -> tuple[Chains, float]:
    began = time.perf_counter()
    found = SAMPLERS[sampler](law, asked)
    return found, time.perf_counter() - began


def _motions(branch: Branch, law: Approximate, values: np.ndarray) -> Motions:
    """Draws under the laws alone."""
    oscillator = law.oscillator
    every = {**law.known, **{n: values[..., i] for i, n in enumerate(law.names)}}
    amplitude = branch.record.reference.amplitude
    return Motions(oscillator, every, branch.record.seen.rest, amplitude, branch.spec.inertia)


def _with_derived(
    summary: dict[str, Any], motions: Motions, ensembles: int | None
) -> tuple[dict[str, Any], dict[str, int]]:
    """Summaries with those of what follows from the draws, and how many draws have none of a quantity."""
    derived = derive(motions)
    partial = {n: int(np.sum(~np.isfinite(v))) for n, v in derived.items() if not np.all(np.isfinite(v))}
    more = {n: diagnostics.summarise(v, ensembles) for n, v in derived.items() if n not in partial}
    return {**summary, **more}, partial


def _curves(law: Approximate, motions: Motions, grid: np.ndarray, u: np.ndarray) -> dict[str, np.ndarray]:
    """Decrement and damping ratio with the deviations over a record's amplitudes, as `posteriors.curves` has them."""
    few = u[:: max(1, len(u) // CURVE_DRAWS)]
    drawn = law.ratio_draws(grid, few)
    whole = np.all(np.isfinite(drawn), axis=0)
    if not whole.any():
        return {"amplitudes": grid[:0]}
    ratio = np.quantile(drawn[:, whole], (*LEVELS, *SPREAD), axis=0)
    found = {"amplitudes": grid[whole], f"curve/{CURVE}": ratio[: len(LEVELS)]}
    found[f"spread/{CURVE}"] = ratio[len(LEVELS) :]
    # A cycle's decrement is so many times its damping ratio, by the restoring law alone.
    plain = against_amplitude(motions, grid[whole], (0.5,))
    found["curve/log_decrement"] = found[f"curve/{CURVE}"] * plain["log_decrement"] / plain[CURVE]
    return found
