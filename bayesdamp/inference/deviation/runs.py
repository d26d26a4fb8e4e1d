"""Draws of the motions themselves, by independent runs of the tempered sampler."""

from __future__ import annotations

import time

import numpy as np

from bayesdamp.inference.checks.diagnostics import summarise, verdict
from bayesdamp.inference.deviation.sampled.candidates import sampled_result
from bayesdamp.inference.deviation.single import Single
from bayesdamp.types import Posterior

APART = 1_000_003
"""Between the seeds of independent runs."""


def sample_motions(single: Single, chains: int, draws: int, seed: int) -> Posterior:
    """Draw the motions themselves, by so many independent runs; the first is `compare`'s for as many draws.

    Returns
    -------
    Posterior
        `arrays["u"]` has each draw with its deviations, (chain, draw, K); `diagnostics` the log evidence in nats, the
        log of the mean of the runs' evidences, and its standard error. Draws that were copied in the last resampling
        count once in effective sample sizes.
    """
    began, each, rows = time.perf_counter(), [], []
    for chain in range(chains):
        run = sampled_result(single.weighing, single.result, True, seed + APART * chain, draws).sampled
        assert run is not None
        each.append(run)
        # A run leaves its draws in the order of what they descend from, which is none of time.
        rows.append(run.draws[np.random.default_rng([seed, chain]).permutation(draws)])
    u = np.stack(rows)
    values = single.values(u)
    likelihood = single.log_likelihoods(single.motions(u.reshape(-1, u.shape[-1]))).sum(axis=1)
    summary = {}
    for i, name in enumerate(single.names):
        one, distinct = summarise(values[..., i]), float(np.unique(values[..., i]).size)
        summary[name] = {**one, **{k: min(one[k], distinct) for k in ("ess_bulk", "ess_tail")}}
    poor = [run.acceptance for run in each if not run.trusted]
    outcome = verdict(summary)
    if poor:
        outcome = f"the motions could not be led to from the linear model: {min(poor):.2f} of the last moves were taken"
    logs, errors = np.array([run.log_evidence for run in each]), np.array([run.stderr for run in each])
    log_evidence, stderr = float(logs.max()), float("nan")
    if np.isfinite(log_evidence):
        weights = np.exp(logs - log_evidence)
        stderr = float(np.linalg.norm(weights * errors) / weights.sum())
        log_evidence = float(np.logaddexp.reduce(logs) - np.log(chains))
    return Posterior(
        sampler="smc",
        names=single.names,
        draws=values,
        log_likelihood=likelihood.reshape(u.shape[:2]),
        stats={
            "acceptance_rate": np.repeat([[run.acceptance] for run in each], draws, axis=1),
            "temperatures": np.repeat([[run.temperatures] for run in each], draws, axis=1),
        },
        diagnostics={"log_evidence": log_evidence, "stderr": stderr},
        seconds=time.perf_counter() - began,
        outcome=outcome,
        summaries=summary,
        arrays={"u": u},
    )
