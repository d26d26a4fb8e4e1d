"""Simulation-based calibration: compute the ranks of true parameters among the draws of their posteriors."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from bayesdamp.calibrate.problem import make_generator, mode_of, record_rng, run_safely
from bayesdamp.config import Study
from bayesdamp.inference.mode import Mode
from bayesdamp.inference.model.target import Target
from bayesdamp.inference.samplers import SAMPLERS, Settings
from bayesdamp.pipeline.tasks import Product
from bayesdamp.store.contents import RanksContent
from bayesdamp.types import OK, InputError

RECORDS_PER_TASK = 16
"""Number of records that one task simulates."""
LIKELIHOOD = "log_likelihood"
"""Name of the log likelihood among the ranked quantities: its rank at the true parameters can show an error that the
rank of no parameter shows (Modrák et al., 2023)."""


def compute_chunk(study: Study, model: str, first: int) -> Product:
    """Draw the records of one task, numbered from `first`, and rank their true parameters among posterior draws.

    Returns
    -------
    Product
        The content is a `RanksContent` with the outcome of each record and the names of the k parameters, the log
        likelihood last. Arrays for c = `RECORDS_PER_TASK` records and s samplers, in the units of the parameters (nats
        for the log likelihood): truth (c, k), the true values; value and stderr (c, k), the refined estimate and its
        standard errors, NaN where missing; ranks (c, s, k), the number of thinned draws below the truth (0 to
        calibration.draws), −1 if the sampler gave no draws; below (c, s, k), the fraction of all draws below the truth,
        then NaN.
    """
    source, table, p = make_generator(study, model), study.calibration, study.posterior
    names = [*source.blank.names, LIKELIHOOD]
    outcomes, modes, began = [OK] * RECORDS_PER_TASK, dict[int, tuple[Target, Mode]](), time.perf_counter()
    truth = np.full((RECORDS_PER_TASK, len(names)), np.nan)
    value, stderr = np.full((2, RECORDS_PER_TASK, len(names)), np.nan)
    for i in range(RECORDS_PER_TASK):
        drawn = source.draw(record_rng(study.seed, model, first + i), f"{model}-{first + i}")
        truth[i, :-1] = [drawn.truth[n] for n in names[:-1]]
        fit, outcomes[i] = run_safely(mode_of, drawn, source.system)
        if fit is None:
            continue
        mode, refined = fit
        modes[i] = drawn.target, mode
        truth[i, -1] = mode.likelihood.log_likelihood(drawn.target.scores(drawn.truth))
        value[i] = [refined.values.get(n, np.nan) for n in names]
        stderr[i] = [refined.stderr.get(n, np.nan) for n in names]
    seconds = {"record": time.perf_counter() - began}
    shape = (RECORDS_PER_TASK, len(table.samplers), len(names))
    ranks, below = np.full(shape, -1), np.full(shape, np.nan)
    sampler_outcomes = {sampler: [""] * RECORDS_PER_TASK for sampler in table.samplers}
    for s, sampler in enumerate(table.samplers):
        began = time.perf_counter()
        for i, (target, mode) in modes.items():
            seed = int(record_rng(study.seed, model, first + i, sampler).integers(2**31 - 2))
            settings = Settings(p.chains, p.warmup, p.draws, seed)
            posterior, outcome = run_safely(SAMPLERS.get(sampler).sample, target, mode, settings)
            sampler_outcomes[sampler][i] = posterior.outcome if posterior else outcome
            if posterior:
                draws = [*np.moveaxis(posterior.draws, -1, 0), posterior.log_likelihood]
                ranks[i, s] = [np.sum(thin(d, table.draws) < t) for t, d in zip(truth[i], draws)]
                below[i, s] = [np.mean(d < t) for t, d in zip(truth[i], draws)]
        seconds[sampler] = time.perf_counter() - began
    content = RanksContent(
        tuple(outcomes),
        tuple(outcome == OK for outcome in outcomes),
        first,
        model=model,
        names=tuple(names),
        sampler_outcomes={sampler: tuple(each) for sampler, each in sampler_outcomes.items()},
        seconds=seconds,
    )
    arrays = {"truth": truth, "value": value, "stderr": stderr, "ranks": ranks, "below": below}
    return Product(content, arrays, seconds=sum(seconds.values()))


def check(study: Study) -> None:
    """Check, before anything is computed, that the study can be calibrated.

    Raises
    ------
    InputError
        If `make_generator` cannot draw records of a model, or calibration.draws is more than the draws of a posterior.
    """
    for model in study.compare(study.signals[0]):
        make_generator(study, model)
    p, table = study.posterior, study.calibration
    if p.chains * p.draws < table.draws:
        raise InputError(
            f"{study.source}: calibration.draws is {table.draws}; it must be at most the {p.chains * p.draws} draws "
            "of [posterior]"
        )


def key_parts(study: Study) -> dict[str, Any]:
    """Return the settings, by name, on which the result of a task depends besides the model and the first record."""
    table, resolved = study.calibration, study.resolved()
    return {
        "signal": resolved["signals"][0],
        "prior": resolved["models"]["prior"],
        "posterior": {k: v for k, v in resolved["posterior"].items() if k != "samplers"},
        "samplers": table.samplers,
        "draws": table.draws,
        "seed": study.seed,
    }


def thin(draws: np.ndarray, count: int) -> np.ndarray:
    """Return `count` draws, shape (count,), that are spread evenly over all chains of `draws`, shape (chain, draw).

    The chains are joined one after the other; the first and the last draw are included. Raises ValueError if there are
    fewer than `count` draws.
    """
    flat = draws.reshape(-1)
    if flat.size < count:
        raise ValueError(f"{count} thinned draws are needed, but there are only {flat.size} draws")
    return flat[np.round(np.linspace(0, flat.size - 1, count)).astype(int)]
