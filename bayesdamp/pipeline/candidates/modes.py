"""Find the highest posterior mode of a candidate from all available starts, and check its fit."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from bayesdamp.inference.checks import check_fit
from bayesdamp.inference.search import group_searches
from bayesdamp.interface.fit import Fit
from bayesdamp.interface.model import (
    PRIOR_STARTS,
    start_from_all_terms,
    start_from_features,
    start_from_regression,
)
from bayesdamp.pipeline.candidates.candidate import StudyCandidate
from bayesdamp.pipeline.records import NOT_APPLICABLE
from bayesdamp.pipeline.tasks import Product, task_seed
from bayesdamp.serial import split
from bayesdamp.store.contents import EstimateContent, MaximumContent, ModeContent, RefusedSeed
from bayesdamp.types import OK, Refusal, Seed


def seeds_of(candidate: StudyCandidate) -> tuple[dict[Seed, Mapping[str, float]], tuple[RefusedSeed, ...]]:
    """Return the starting points of the search for the mode, and the estimators without values.

    A starting point has parameter values by name; its key is a `Seed`, which says where it comes from. The points are
    the finite values of every estimator at each of its stages, and values from the record's frequency and decay. If no
    estimator has finite values, the estimates of least squares are used. The estimators without values are returned
    with their outcomes. With many candidates (`has_many_rivals`), the fit of all terms in the answer is a starting
    point too. Raises Refusal if there is no starting point.
    """
    seeds: dict[Seed, Mapping[str, float]] = {}
    refused: list[RefusedSeed] = []
    for method in candidate.methods:
        result = candidate.store.read(f"estimate/{candidate.path}/{method}")
        for stage in EstimateContent.of(result).stages:
            seed = Seed(method, stage.stage)
            if stage.values and np.all(np.isfinite(list(stage.values.values()))):
                seeds[seed] = stage.values
            else:
                refused.append(RefusedSeed(seed, stage.outcome))
        if result.outcome != OK:
            refused.append(RefusedSeed(Seed(method), result.outcome))
    problem = candidate.problem
    if not seeds:
        seeds |= start_from_regression(candidate.record.signal, problem)[0]
    decays = start_from_features(candidate.record.signal, candidate.record.features, problem)
    seeds = decays | seeds
    fit = (
        candidate.answer.fits.get(candidate.restoring)
        if candidate.has_many_rivals and candidate.answer
        else None
    )
    if candidate.answer and fit:
        seeds = start_from_all_terms(fit, candidate.answer.terms, problem, decays) | seeds
    if not seeds:
        raise Refusal("no estimator returned values from which the search for the mode could start")
    return seeds, tuple(refused)


def compute_mode(candidate: StudyCandidate) -> Product:
    """Return the highest posterior mode that is found, with the checks of its fit.

    The content is a `ModeContent`. The arrays are the times `t` in s, the motion `fit` and the `residual` in the unit
    of the record, the whitened residuals and their autocorrelation, and the mode itself. Raises Refusal if the search
    finds none, or if the record has no noise.
    """
    if not candidate.record.content.noisy:
        raise Refusal(NOT_APPLICABLE)
    seeds, refused = seeds_of(candidate)
    mode = candidate.case.mode(
        candidate.noise,
        candidate.epsilon,
        seeds,
        draws=0 if candidate.has_many_rivals else PRIOR_STARTS,
        seed=task_seed(candidate.study, f"seeds/{candidate.path}"),
        thrifty=candidate.has_many_rivals,
    )
    fit, target = Fit.at_mode(candidate.record.signal, candidate.case.model, mode), mode.likelihood.target
    seed = task_seed(candidate.study, f"checks/{candidate.spec.name}/{candidate.repeat}")
    checks, residuals = check_fit(target, mode, candidate.record.features.period, seed)
    arrays = {"t": candidate.record.signal.t, **residuals}
    maxima, numbers = group_searches(mode)
    climbs = []
    for search, number in zip(mode.searches, numbers, strict=True):
        away = search.origin - mode.z
        distance = float(np.sqrt(max(away @ mode.information @ away, 0.0)))
        own = {k: v for k, v in vars(search).items() if k not in ("origin", "z")}
        climbs.append({**own, "distance": distance, "mode": number})
    scores = zip(target.names, mode.z, mode.sd(), target.reflected, strict=True)
    # Later tasks read the mode from its stored result, never from memory: the step sizes of the solver are then chosen
    # again, which changes evidence by some 1e-8 nats, and an interrupted run must give the same numbers.
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
