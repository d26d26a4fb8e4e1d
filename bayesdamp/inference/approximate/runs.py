"""Draws of the motions themselves, by independent runs of the tempered sampler, and summaries of draws."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayesdamp.inference.approximate.law import Approximate
from bayesdamp.inference.checks.diagnostics import summarise
from bayesdamp.inference.deviation.gaussian.tempered import Sampled
from bayesdamp.inference.deviation.sampled.candidates import sampled_result
from bayesdamp.types import OK

Array = NDArray[np.float64]
APART = 1_000_003
"""Between the seeds of independent runs."""


@dataclass(frozen=True)
class Runs:
    """Independent runs of the tempered sampler. u: (run, draw, K); log_likelihood: (run, draw), nats; each run's own
    record: evidence and its standard error, temperatures, acceptance of the last moves."""

    u: Array
    log_likelihood: Array
    each: tuple[Sampled, ...]
    seconds: float

    @property
    def log_evidence(self) -> tuple[float, float]:
        """In nats, from the mean of the runs' evidences, with its standard error."""
        logs = np.array([r.log_evidence for r in self.each])
        top = float(logs.max())
        if not np.isfinite(top):
            return top, float("nan")
        weights = np.exp(logs - top)
        errors = np.array([r.stderr for r in self.each])
        stderr = float(np.sqrt(np.sum((weights * errors) ** 2)) / weights.sum())
        return top + float(np.log(weights.mean())), stderr

    @property
    def outcome(self) -> str:
        """ "ok", or why they are not to be trusted."""
        poor = [r.acceptance for r in self.each if not r.trusted]
        if not poor:
            return OK
        return f"the motions could not be led to from the linear model: {min(poor):.2f} of the last moves were taken"


def runs_of(approximate: Approximate, chains: int, draws: int, seed: int) -> Runs:
    """Draws of the motions themselves, by so many independent runs; the first is `compare`'s for as many draws."""
    began, one = time.perf_counter(), approximate.single
    each, rows = [], []
    for chain in range(chains):
        found = sampled_result(one.weighing, one.result, True, seed + APART * chain, draws).sampled
        assert found is not None
        each.append(found)
        # A run leaves its draws in the order of what they descend from, which is none of time.
        rows.append(found.draws[np.random.default_rng([seed, chain]).permutation(draws)])
    u = np.stack(rows)
    motions = approximate.motions(u.reshape(-1, u.shape[-1]))
    total = approximate.log_likelihoods(motions).sum(axis=1).reshape(u.shape[:2])
    return Runs(u, total, tuple(each), time.perf_counter() - began)


def summaries_of(
    approximate: Approximate, draws: Array, ensembles: int | None = None
) -> dict[str, dict[str, float]]:
    """Of draws (chain, draw, parameter), by name; draws that were copied in the last resampling count once.

    ensembles: into which the chains fall, where those of one share their moves."""
    found = {}
    for i, name in enumerate(approximate.names):
        one = summarise(draws[..., i], ensembles)
        distinct = float(np.unique(draws[..., i]).size)
        noise = min(approximate.noise_sds[name], one["sd"])
        parts = {"sd_noise": noise, "sd_law": float(np.sqrt(one["sd"] ** 2 - noise**2))}
        ess = {k: min(one[k], distinct) for k in ("ess_bulk", "ess_tail")}
        found[name] = {**one, **ess, **parts}
    return found
