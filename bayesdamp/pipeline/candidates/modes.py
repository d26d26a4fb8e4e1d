"""The highest mode of a candidate on a record, from every start that there is, with the checks of its fit."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from bayesdamp.inference.checks.checks import check_fit
from bayesdamp.inference.fit.search import find_mode
from bayesdamp.inference.fit.starting_points import prior_starts
from bayesdamp.pipeline.candidates.branch import Branch
from bayesdamp.pipeline.records.records import NOT_APPLICABLE, cell_seed, plain_seconds
from bayesdamp.pipeline.records.starts import observed, of_all, regression
from bayesdamp.pipeline.records.stored_modes import packed
from bayesdamp.store import CellResult
from bayesdamp.store.contents.candidates import BesideIt, Part, RefusedSeed, SecondHalf
from bayesdamp.store.contents.estimates import EstimateContent
from bayesdamp.types import OK, Problem, Refusal, Seed

PRIOR_SEEDS = 2
"""Draws from the prior that are climbed from beside the estimates."""
CHECKS = ("fit", "residual", "whitened", "autocorrelation")
"""What of the checks of a fit is stored as arrays."""


def seeds_of(branch: Branch) -> tuple[dict[Seed, Mapping[str, float]], tuple[RefusedSeed, ...]]:
    """Seeds with their values, and what methods said that have none.

    Seeds are every estimator's values at each of its stages; what the record's frequency and decay say; draws from the
    prior. With no estimator in the study, least squares'. Raises Refusal where there is nothing to start from.
    """
    seeds: dict[Seed, Mapping[str, float]] = {}
    refused: list[RefusedSeed] = []
    for method in branch.methods:
        cell = branch.store.read(f"estimate/{branch.path}/{method}")
        for stage in EstimateContent.of(cell).stages:
            seed = Seed(method, stage.stage)
            if stage.values and np.all(np.isfinite(list(stage.values.values()))):
                seeds[seed] = stage.values
            else:
                refused.append(RefusedSeed(seed, stage.outcome))
        if cell.outcome != OK:
            refused.append(RefusedSeed(Seed(method), cell.outcome))
    problem = Problem(branch.terms, branch.system)
    if not seeds:
        seeds |= regression(branch.record, problem)[0]
    decays = observed(branch.record, problem)
    seeds = decays | seeds
    fit = branch.answer.fits.get(branch.restoring) if branch.many and branch.answer else None
    if branch.answer and fit:
        seeds = of_all(fit, branch.answer.terms, problem, decays) | seeds
    if not seeds:
        raise Refusal("no estimator found a place to start from")
    count = 0 if branch.many else PRIOR_SEEDS
    from_prior = prior_starts(branch.target, count, cell_seed(branch.study, f"seeds/{branch.path}"))
    return seeds | from_prior, tuple(refused)


def compute_mode(branch: Branch, name: str, key: str) -> None:
    """Store the highest mode with what was checked of its fit, or why there is none."""
    began = time.perf_counter()
    if not branch.record.content.noisy:
        branch.store.write(CellResult(name, key, outcome=NOT_APPLICABLE))
        return
    try:
        (seeds, refused), seen = seeds_of(branch), branch.record.seen
        mode = find_mode(
            branch.target,
            seeds,
            noise_level=seen.roughness,
            period=seen.period,
            thrifty=branch.many,
        )
    except Refusal as refusal:
        branch.store.write(CellResult(name, key, outcome=str(refusal), seconds=plain_seconds(began)))
        return
    seed = cell_seed(branch.study, f"checks/{branch.spec.name}/{branch.repeat}")
    fit = check_fit(branch.target, mode, branch.record.seen.period, seed)
    found, scores = packed(mode)
    later = fit.forecast
    checked = replace(
        found,
        refused=refused,
        windows=tuple(Part(**vars(w)) for w in fit.windows),
        forecast=None if later is None else SecondHalf(**vars(later)),
        rivals=tuple(BesideIt(r.words, r.log_bayes) for r in fit.rivals),
        **{k: v for k, v in vars(fit).items() if k not in (*CHECKS, "windows", "forecast", "rivals")},
    )
    arrays = {"t": branch.record.signal.t, **scores, **{k: getattr(fit, k) for k in CHECKS}}
    # What comes next reads the mode from its cell, as a run that was cut off in between does: the solver's plan is
    # made anew there, and evidence on the plan that found the mode is some 1e-8 nats apart.
    branch.store.write(CellResult(name, key, checked.meta(), arrays, OK, plain_seconds(began)))
