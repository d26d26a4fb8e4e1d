"""Claims, measurements on the paper's records, verdicts, and the page that lists them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from bayesdamp.estimators import run
from bayesdamp.formatting import markdown_table
from bayesdamp.physics.damping import TERMS
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.records.oscillation.features import features
from bayesdamp.records.simulate import simulate_signal
from bayesdamp.report.results.estimators import (
    ErrorSeries,
    EstimatorComparison,
    compare_estimators,
    error_series,
)
from bayesdamp.report.results.run import RunFolder
from bayesdamp.types import Estimate, Problem, Signal, System

Verdict = Literal["holds", "does not hold", "holds in part", "better than claimed", "cannot be judged"]
"""Verdicts on a claim. "Better than claimed": so far below the printed error or time that it is not confirmed."""
MUCH_SMALLER = 10.0
"""An error below the printed one by more than this factor does not confirm it."""
TRUTH = {"viscous": 0.05, "coulomb": 0.03, "quadratic": 0.05}
"""True coefficients of the paper's records (its section 2.3)."""
PENDULUM = {"stiffness": 20.0, "gravity": 1.0, "spring_angle": 0.0}
SPRING = {"stiffness": 20.0, "rest_angle": 0.0}
START = {"theta0": 0.3, "omega0": 0.0}
SEED = 20260101


@dataclass(frozen=True)
class Judgement:
    """The verdict on a claim, and a description of the measurement."""

    verdict: Verdict
    measured: str


@dataclass(frozen=True)
class Runs:
    """The runs of studies by which claims are judged.

    Attributes
    ----------
    paper
        Folder of the run of the study `paper`; None without one.
    noise
        Folders of the runs of the studies `noise*`.
    """

    paper: Path | None = None
    noise: tuple[Path, ...] = ()

    @cached_property
    def compared(self) -> EstimatorComparison | None:
        """The comparison of estimators on the paper's records without noise; None without a run."""
        return compare_estimators(RunFolder(self.paper)) if self.paper else None

    @cached_property
    def along_noise(self) -> list[ErrorSeries]:
        """The errors of the estimators along the noise level: a series for each damping in each run of `noise`."""
        return [s for folder in self.noise for s in error_series(RunFolder(folder)) if s.factor == "noise"]


Judge = Callable[[Runs], Judgement]


@dataclass(frozen=True)
class Claim:
    """A claim of the paper.

    Attributes
    ----------
    text
        The claim, in our words.
    where
        Section, table or figure of the paper.
    judge
        Function that measures and judges.
    """

    text: str
    where: str
    judge: Judge


def claim(claims: list[Claim], text: str, where: str) -> Callable[[Judge], Judge]:
    """Return a decorator that adds a claim to a list, with the decorated function, which stays as it is, as its judge.

    text, where: as in `Claim`.
    """

    def add(judge: Judge) -> Judge:
        claims.append(Claim(text, where, judge))
        return judge

    return add


NO_RUN = Judgement("cannot be judged", "The run that this claim needs is missing.")


def on_clean(judge: Callable[[EstimatorComparison], Judgement]) -> Judge:
    """Return a judge of runs that applies `judge` to their comparison on records without noise.

    Without this comparison it returns `NO_RUN`.
    """
    return lambda runs: judge(runs.compared) if runs.compared else NO_RUN


@lru_cache
def paper_record(
    damping: str, restoring: str = "horizontal_pendulum", epsilon: float = 0.1
) -> tuple[Signal, Problem]:
    """Return the paper's record with a damping term (5,000 samples in 10 s, no noise), and its estimation problem."""
    law = PENDULUM if restoring == "horizontal_pendulum" else SPRING
    known = {**law, **START, "epsilon": epsilon}
    osc = Oscillator((damping,), restoring)
    truth = {**known, TERMS.get(damping).parameter: TRUTH[damping]}
    signal = simulate_signal(
        osc, truth, duration=10.0, samples=5000, noise_sd=0.0, rng=np.random.default_rng(SEED), name=damping
    )
    return signal, Problem((damping,), System(restoring, known))


def initial_estimate(
    method: str,
    damping: str,
    options: Mapping[str, object] | None = None,
    *,
    restoring: str = "horizontal_pendulum",
    simulated: float = 0.1,
    assumed: float = 0.1,
) -> Estimate:
    """Return the initial estimate of a method on the paper's record.

    Parameters
    ----------
    method, damping, options, restoring
        The estimator and its options, and the record.
    simulated
        Width ε of friction in the simulated record (rad/s).
    assumed
        Width ε of friction that the estimator is given (rad/s).
    """
    signal, problem = paper_record(damping, restoring, simulated)
    if assumed != simulated:
        problem = Problem(problem.damping, System(restoring, {**problem.system.known, "epsilon": assumed}))
    return run(method, signal, problem, options=options, stages=("initial",), seed=SEED)[0]


def error_of(estimate: Estimate, damping: str) -> float:
    """Return the error of an estimate in per cent of the truth; nan if it has no value."""
    value = estimate.values.get(TERMS.get(damping).parameter, np.nan)
    return 100 * abs(value / TRUTH[damping] - 1)


def initial_error(
    method: str, damping: str, options: Mapping[str, object] | None = None, **record: Any
) -> float:
    """Return the error of `initial_estimate(...)` in per cent of the truth."""
    return error_of(initial_estimate(method, damping, options, **record), damping)


def period_drift(damping: str) -> float:
    """Return the difference of the mean periods in the two halves of the paper's record, in per cent."""
    signal, _ = paper_record(damping)
    crossings = features(signal).crossing_times
    periods = crossings[2:] - crossings[:-2]
    half = periods.size // 2
    return float(100 * abs(periods[:half].mean() / periods[half:].mean() - 1))


def judge_all(claims: Iterable[Claim], runs: Runs) -> list[tuple[Claim, Judgement]]:
    """Return each claim with its judgement, in their order."""
    return [(claim, claim.judge(runs)) for claim in claims]


def write_page(judgements: Iterable[tuple[Claim, Judgement]], runs: Runs) -> str:
    """Return the page of claims and verdicts in Markdown, with the runs on which it is based."""
    judgements = list(judgements)
    counts = Counter(judgement.verdict for _, judgement in judgements)
    verdicts = [f"{verdict} {counts[verdict]}" for verdict in get_args(Verdict) if counts[verdict]]
    rows = [(c.text, c.where, j.measured, f"**{j.verdict}**") for c, j in judgements]
    lines = [
        "# The paper's claims, measured",
        "",
        f"Verdicts on {len(judgements)} claims: {', '.join(verdicts)}.",
        "",
        "Made by `bayesdamp claims`. Errors are in per cent of the truth: *initial* is the method's own estimate,",
        "*refined* is the trajectory fit that starts there. *Better than claimed* means that an error is more than ten",
        "times, or a time more than three times, below the printed one; such a figure does not confirm the claim.",
        "",
        markdown_table(("claim", "where", "measured", "verdict"), rows),
    ]
    for folder in (runs.paper, *runs.noise):
        if folder is not None:
            code = str(RunFolder(folder).info.get("revision") or "an unknown revision")
            lines += ["", f"Judged by the run `{folder.name}` next to this page, computed by {code}."]
    return "\n".join(lines) + "\n"
