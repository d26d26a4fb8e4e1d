"""The highest mode of a candidate on a record, from every start that there is, with the checks of its fit."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from bayesdamp.inference.checks import check_fit
from bayesdamp.inference.search import basins
from bayesdamp.interface.fit import Fit
from bayesdamp.interface.model import (
    PRIOR_STARTS,
    start_from_all_terms,
    start_from_features,
    start_from_regression,
)
from bayesdamp.pipeline.candidates.branch import Branch
from bayesdamp.pipeline.records import NOT_APPLICABLE
from bayesdamp.pipeline.tasks import Product, cell_seed
from bayesdamp.serial import split
from bayesdamp.store.contents import EstimateContent, MaximumContent, ModeContent, RefusedSeed
from bayesdamp.types import OK, Refusal, Seed


def seeds_of(branch: Branch) -> tuple[dict[Seed, Mapping[str, float]], tuple[RefusedSeed, ...]]:
    """Return seeds with their values, and the outcomes of methods that have none.

    Seeds are every estimator's values at each of its stages, and values from the record's frequency and decay. With no
    estimator in the study, least squares' values are used. Raises Refusal where there is no start.
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
    problem = branch.problem
    if not seeds:
        seeds |= start_from_regression(branch.record.signal, problem)[0]
    decays = start_from_features(branch.record.signal, branch.record.features, problem)
    seeds = decays | seeds
    fit = branch.answer.fits.get(branch.restoring) if branch.many and branch.answer else None
    if branch.answer and fit:
        seeds = start_from_all_terms(fit, branch.answer.terms, problem, decays) | seeds
    if not seeds:
        raise Refusal("no estimator found a place to start from")
    return seeds, tuple(refused)


def compute_mode(branch: Branch) -> Product:
    """Return the highest mode with the checks of its fit. Raises Refusal where there is none."""
    if not branch.record.content.noisy:
        raise Refusal(NOT_APPLICABLE)
    seeds, refused = seeds_of(branch)
    mode = branch.case.mode(
        branch.noise,
        branch.epsilon,
        seeds,
        draws=0 if branch.many else PRIOR_STARTS,
        seed=cell_seed(branch.study, f"seeds/{branch.path}"),
        thrifty=branch.many,
    )
    fit, target = Fit.at_mode(branch.record.signal, branch.case.model, mode), mode.likelihood.target
    seed = cell_seed(branch.study, f"checks/{branch.spec.name}/{branch.repeat}")
    checks, residuals = check_fit(target, mode, branch.record.features.period, seed)
    arrays = {"t": branch.record.signal.t, **residuals}
    maxima, numbers = basins(mode)
    climbs = []
    for search, number in zip(mode.searches, numbers, strict=True):
        away = search.origin - mode.z
        distance = float(np.sqrt(max(away @ mode.information @ away, 0.0)))
        own = {k: v for k, v in vars(search).items() if k not in ("origin", "z")}
        climbs.append({**own, "distance": distance, "mode": number})
    scores = zip(target.names, mode.z, mode.sd(), target.reflected, strict=True)
    # Later tasks read the mode from its cell, as a run that was cut off in between does: the solver's plan is made
    # again there, and evidence on the plan that found the mode differs by some 1e-8 nats.
    content = {
        **vars(checks),
        "climbs": climbs,
        "modes": [
            MaximumContent(climb.end, share, {n: float(v) for n, v in target.values(climb.z).items()})
            for climb, share in maxima
        ],
        "touching_zero": [n for n, z, sd, reflected in scores if reflected and abs(z) < sd],
        "values": fit.values,
        "sd": fit.sd,
        "known": fit.known,
        "priors": {n: p.describe() for n, p in fit.priors.items()},
        "log_posterior": mode.log_posterior,
        "error_budget": {"step_error": mode.step_error, "log_likelihood_change": mode.likelihood_error},
        "refused": refused,
        "stored": split(mode.stored, arrays, "stored"),
    }
    return Product(ModeContent.of_meta(split(content)), arrays)
