"""Simulation-based calibration: where the truth of a record lies among the draws of its posterior."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from bayesdamp.calibrate.problem import (
    generator,
    mode_of,
    record_rng,
)
from bayesdamp.calibrate.statistics import thin
from bayesdamp.config import Study
from bayesdamp.inference.fit.mode import Mode
from bayesdamp.inference.model.target import Target
from bayesdamp.inference.samplers import SAMPLERS, Settings
from bayesdamp.pipeline.tasks import Product, failure
from bayesdamp.store.contents import RanksContent
from bayesdamp.types import OK, InputError, Refusal

CHUNK = 16
"""Records of one task."""
LIKELIHOOD = "log_likelihood"
"""Ranked with the parameters: it sees what the ranks of single parameters may not (Modrák et al., 2023)."""


def ranked(study: Study, model: str, first: int) -> Product:
    """A chunk of records of one model, numbered from `first`.

    Its content is a `RanksContent`: names of the parameters, and the likelihood last. arrays: truth (c, k), value and
    stderr of the refined estimate (c, k), and by sampler, shape (c, s, k): ranks among the thinned draws (−1 where
    there are none) and below, the share of all draws below the truth.
    """
    made, table, p = generator(study, model), study.calibration, study.posterior
    names = [*made.blank.names, LIKELIHOOD]
    outcomes, modes, began = [OK] * CHUNK, dict[int, tuple[Target, Mode]](), time.perf_counter()
    truth = np.full((CHUNK, len(names)), np.nan)
    value, stderr = np.full((2, CHUNK, len(names)), np.nan)
    for i in range(CHUNK):
        drawn = made.draw(record_rng(study.seed, model, first + i), f"{model}-{first + i}")
        truth[i, :-1] = [drawn.truth[n] for n in names[:-1]]
        try:
            mode, refined = mode_of(drawn, made.system)
        except Refusal as refusal:
            outcomes[i] = str(refusal)
            continue
        except Exception as fault:
            outcomes[i] = failure(fault)
            continue
        modes[i] = drawn.target, mode
        truth[i, -1] = mode.likelihood.log_likelihood(drawn.target.scores(drawn.truth))
        value[i] = [refined.values.get(n, np.nan) for n in names]
        stderr[i] = [refined.stderr.get(n, np.nan) for n in names]
    seconds = {"record": time.perf_counter() - began}
    shape = (CHUNK, len(table.samplers), len(names))
    ranks, below, said = np.full(shape, -1), np.full(shape, np.nan), dict[str, list[str]]()
    for s, sampler in enumerate(table.samplers):
        began, said[sampler] = time.perf_counter(), [""] * CHUNK
        for i, (target, mode) in modes.items():
            seed = int(record_rng(study.seed, model, first + i, sampler).integers(2**31 - 2))
            try:
                settings = Settings(p.chains, p.warmup, p.draws, seed)
                posterior = SAMPLERS.get(sampler).sample(target, mode, settings)
            except Refusal as refusal:
                said[sampler][i] = str(refusal)
                continue
            except Exception as fault:
                said[sampler][i] = failure(fault)
                continue
            said[sampler][i] = posterior.outcome
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
        sampler_outcomes={s: tuple(one) for s, one in said.items()},
        seconds=seconds,
    )
    arrays = {"truth": truth, "value": value, "stderr": stderr, "ranks": ranks, "below": below}
    return Product(content, arrays, seconds=sum(seconds.values()))


def checked(study: Study) -> None:
    """Raises InputError, before anything is computed, where the study cannot be calibrated."""
    for model in study.compare(study.signals[0]):
        generator(study, model)
    p, table = study.posterior, study.calibration
    if p.chains * p.draws < table.draws:
        raise InputError(
            f"{study.source}: calibration.draws is {table.draws}; it must be at most the {p.chains * p.draws} draws "
            "of [posterior]"
        )


def asked(study: Study) -> dict[str, Any]:
    """What a chunk's result depends on, besides the model and its first record."""
    table, resolved = study.calibration, study.resolved()
    return {
        "signal": resolved["signals"][0],
        "prior": resolved["models"]["prior"],
        "posterior": {k: v for k, v in resolved["posterior"].items() if k != "samplers"},
        "samplers": table.samplers,
        "draws": table.draws,
        "seed": study.seed,
    }
