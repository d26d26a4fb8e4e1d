"""Simulation-based calibration: where the truth of a record lies among the draws of its posterior."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from bayesdamp.calibrate import statistics as calibration
from bayesdamp.calibrate.problem import (
    Drawn,
    Generator,
    failure,
    generator,
    mode_of,
    record_rng,
)
from bayesdamp.config import Study
from bayesdamp.inference.fit.mode import Mode
from bayesdamp.inference.samplers import SAMPLERS, Settings
from bayesdamp.store import CellResult
from bayesdamp.store.contents.calibration import RanksContent
from bayesdamp.types import OK, InputError, Posterior, Refusal

CHUNK = 16
"""Records of one task."""
LIKELIHOOD = "log_likelihood"
"""Ranked with the parameters: it sees what the ranks of single parameters may not (Modrák et al., 2023)."""


@dataclass(frozen=True)
class _Fit:
    drawn: Drawn
    mode: Mode
    estimate: Mapping[str, float]
    stderr: Mapping[str, float]


def ranked(study: Study, model: str, first: int) -> CellResult:
    """A chunk of records of one model, numbered from `first`.

    Its content is a `RanksContent`: names of the parameters, and the likelihood last. arrays: truth (c, k), value and
    stderr of the refined estimate (c, k), and by sampler, shape (c, s, k): ranks among the thinned draws (−1 where
    there are none) and below, the share of all draws below the truth.
    """
    made, table = generator(study, model), study.calibration
    names = [*made.blank.names, LIKELIHOOD]
    outcomes, fits, began = [OK] * CHUNK, dict[int, _Fit](), time.perf_counter()
    truth = np.full((CHUNK, len(names)), np.nan)
    value, stderr = np.full((2, CHUNK, len(names)), np.nan)
    for i in range(CHUNK):
        drawn = made.draw(record_rng(study.seed, model, first + i), f"{model}-{first + i}")
        truth[i, :-1] = [drawn.truth[n] for n in names[:-1]]
        try:
            fits[i] = _fit(made, drawn)
        except Refusal as refusal:
            outcomes[i] = str(refusal)
            continue
        except Exception as fault:
            outcomes[i] = failure(fault)
            continue
        fit = fits[i]
        truth[i, -1] = _log_likelihood(fit)
        value[i] = [fit.estimate.get(n, np.nan) for n in names]
        stderr[i] = [fit.stderr.get(n, np.nan) for n in names]
    seconds = {"record": time.perf_counter() - began}
    shape = (CHUNK, len(table.samplers), len(names))
    ranks, below, said = np.full(shape, -1), np.full(shape, np.nan), dict[str, list[str]]()
    for s, sampler in enumerate(table.samplers):
        began, said[sampler] = time.perf_counter(), [""] * CHUNK
        for i, posterior in _sampled(study, model, sampler, first, fits).items():
            said[sampler][i] = posterior if isinstance(posterior, str) else posterior.outcome
            if isinstance(posterior, str):
                continue
            draws = [*np.moveaxis(posterior.draws, -1, 0), posterior.log_likelihood]
            ranks[i, s] = [np.sum(calibration.thin(d, table.draws) < t) for t, d in zip(truth[i], draws)]
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
    return CellResult("", "", content.meta(), arrays, OK, sum(seconds.values()))


def _fit(made: Generator, drawn: Drawn) -> _Fit:
    mode, refined = mode_of(drawn, made.system)
    return _Fit(drawn, mode, refined.values, refined.stderr)


def _log_likelihood(fit: _Fit) -> float:
    target = fit.drawn.target
    z = target.scores(fit.drawn.truth)
    return fit.mode.likelihood.log_likelihood(z)


def _sampled(
    study: Study, model: str, sampler: str, first: int, fits: Mapping[int, _Fit]
) -> dict[int, Posterior | str]:
    """The posterior of each record, or the sentence with which the sampler refused it."""
    p = study.posterior
    seeds = {i: int(record_rng(study.seed, model, first + i, sampler).integers(2**31 - 2)) for i in fits}
    found: dict[int, Posterior | str] = {}
    for i, fit in fits.items():
        own = Settings(p.chains, p.warmup, p.draws, seeds[i])
        try:
            found[i] = SAMPLERS.get(sampler).sample(fit.drawn.target, fit.mode, own)
        except Refusal as refusal:
            found[i] = str(refusal)
        except Exception as fault:
            found[i] = failure(fault)
    return found


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
