"""Define claims of the paper on eleven damping estimators, and judge them by measurements.

The module also simulates the paper's records, measures on them, and writes the page of verdicts.
"""

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

TITLE = "# The paper's claims, measured\n"
"""First line of the page of verdicts. An existing file that begins with it may be overwritten."""
Verdict = Literal["holds", "does not hold", "holds in part", "better than claimed", "cannot be judged"]
"""Verdicts on a claim of the paper. "Better than claimed": the measured error or time is so far below the printed value
that it does not confirm this value."""
MUCH_SMALLER = 10.0
"""If a measured error is smaller than the error printed in the paper by more than this factor, the claim is judged
"better than claimed" instead of "holds"."""
MUCH_FASTER = 3.0
"""If a measured value, such as a time, is below the range printed in the paper by more than this factor, the claim is
judged "better than claimed" instead of "holds". The times of different computers differ by less than this factor."""
TRUTH = {"viscous": 0.05, "coulomb": 0.03, "quadratic": 0.05}
"""True damping coefficient of each of the paper's three records (its section 2.3): viscous in 1/s, Coulomb in rad/s²,
quadratic in 1/rad."""
PENDULUM = {"stiffness": 20.0, "gravity": 1.0, "spring_angle": 0.0}
"""Parameters of the paper's horizontal pendulum: stiffness in 1/s², gravity in rad/s², spring angle in rad."""
SPRING = {"stiffness": 20.0, "rest_angle": 0.0}
"""Parameters of the linear spring with which the pendulum is compared: stiffness in 1/s², rest angle in rad."""
START = {"theta0": 0.3, "omega0": 0.0}
"""Angle (rad) and velocity (rad/s) at the start of the paper's records."""
SEED = 20260101
"""Seed of the random numbers of the simulation and of the estimators."""


@dataclass(frozen=True)
class Judgement:
    """The verdict on a claim of the paper, and a sentence (`measured`) with the measurement on which it is based."""

    verdict: Verdict
    measured: str


@dataclass(frozen=True)
class Runs:
    """The folders of finished runs whose results decide on claims of the paper.

    Attributes
    ----------
    paper
        Folder of a run of the study `paper` (the paper's records, without noise); None if there is no such run.
    noise
        Folders of runs of the studies `noise`, `noise_coulomb` and `noise_quadratic` (the same records with noise).
    """

    paper: Path | None = None
    noise: tuple[Path, ...] = ()

    @cached_property
    def compared(self) -> EstimatorComparison | None:
        """The errors and times of estimators on the paper's records without noise; None if there is no run."""
        return compare_estimators(RunFolder(self.paper)) if self.paper else None

    @cached_property
    def along_noise(self) -> list[ErrorSeries]:
        """The errors of the estimators as functions of the noise level, which is in per cent of the first amplitude.

        The list contains one series for each run in `noise` and each damping with at least three noise levels in it. It
        is empty without runs.
        """
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
        Section, table or figure of the paper that contains it.
    judge
        Function that measures and judges: it returns a `Judgement` from the `Runs`.
    """

    text: str
    where: str
    judge: Judge


def claim(claims: list[Claim], text: str, where: str) -> Callable[[Judge], Judge]:
    """Return a decorator that appends a `Claim` to `claims`; the decorated function becomes its `judge`.

    The function itself is not changed. text: the claim, in our words. where: section, table or figure of the paper.
    """

    def add(judge: Judge) -> Judge:
        claims.append(Claim(text, where, judge))
        return judge

    return add


NO_RUN = Judgement("cannot be judged", "The run that this claim needs is missing.")
"""Judgement on a claim for which the results of a run are needed that does not exist or does not contain them."""


def on_clean(judge: Callable[[EstimatorComparison], Judgement]) -> Judge:
    """Convert a function that judges by the comparison on records without noise to a function that judges by `Runs`.

    The returned function applies `judge` to `runs.compared`. If there is no such comparison, it returns `NO_RUN`, the
    judgement "cannot be judged".
    """
    return lambda runs: judge(runs.compared) if runs.compared else NO_RUN


def verdict_of(own: float, low: float, high: float, factor: float = MUCH_FASTER) -> Verdict:
    """Return the verdict on a claim that prints a range, `low` to `high`, from the measured value `own`.

    All three have the same unit; a small value is good. The claim "holds" if the value is between `low` / `factor` and
    `high`. It is "better than claimed" if the value is below `low` / `factor`, also if it is -inf. It "does not hold"
    if the value is above `high`. It "cannot be judged" if the value is nan, or inf while `high` is finite.
    """
    if not own <= high:
        return "does not hold" if np.isfinite(own) else "cannot be judged"
    return "better than claimed" if own < low / factor else "holds"


@lru_cache
def paper_record(
    damping: str, restoring: str = "horizontal_pendulum", epsilon: float = 0.1
) -> tuple[Signal, Problem]:
    """Simulate the paper's record with one damping term (5,000 samples in 10 s, no noise, from 0.3 rad at rest).

    Parameters
    ----------
    damping
        The damping term; its coefficient is that of `TRUTH`.
    restoring
        "horizontal_pendulum" for the paper's pendulum, or "linear" for a spring (stiffness 20/s², equilibrium at 0).
    epsilon
        Velocity in rad/s within which Coulomb friction changes its sign smoothly (tanh); 0 for the sign function.

    Returns
    -------
    tuple
        The record, and the problem for an estimator: the damping term, and all parameters except its coefficient, which
        are known.
    """
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
    """Return the initial estimate of a method on the paper's record, without the refinement by a trajectory fit.

    Parameters
    ----------
    method, options
        Name of the estimator, and its options by name.
    damping, restoring
        Damping term of the record, and its restoring law: "horizontal_pendulum" for the paper's pendulum, or "linear"
        for a spring with the same stiffness.
    simulated
        Velocity in rad/s within which Coulomb friction changes its sign in the simulated record; 0 for the sign
        function. It has no effect on records with another damping.
    assumed
        The value of this velocity in rad/s that the estimator assumes.

    Returns
    -------
    Estimate
        The estimate; without values, and with the reason as its outcome, if the method failed.
    """
    signal, problem = paper_record(damping, restoring, simulated)
    if assumed != simulated:
        problem = Problem(problem.damping, System(restoring, {**problem.system.known, "epsilon": assumed}))
    return run(method, signal, problem, options=options, stages=("initial",), seed=SEED)[0]


def initial_error(
    method: str, damping: str, options: Mapping[str, object] | None = None, **record: Any
) -> float:
    """Return the absolute error of a method's initial estimate on the paper's record, in per cent of the truth.

    The arguments are those of `initial_estimate`; `record` may contain `restoring` (a law), and the widths ε of
    friction (rad/s) that are `simulated` and `assumed` by the method. The truth is the damping coefficient in `TRUTH`.
    The error is nan if there is no estimate.
    """
    estimate = initial_estimate(method, damping, options, **record)
    value = estimate.values.get(TERMS.get(damping).parameter, np.nan)
    return 100 * abs(value / TRUTH[damping] - 1)


def period_drift(damping: str) -> float:
    """Return the relative change of the mean period during the paper's pendulum record with this damping, in per cent.

    It is 100·|P₁/P₂ − 1|, where P₁ is the mean period in the first half of the record's periods, and P₂ in the second
    half. damping: name of the damping term, whose coefficient is that in `TRUTH`.
    """
    signal, _ = paper_record(damping)
    turns = features(signal).turning_times
    periods = turns[2:] - turns[:-2]
    half = periods.size // 2
    return float(100 * abs(periods[:half].mean() / periods[half:].mean() - 1))


def page_of_verdicts(claims: Iterable[Claim], runs: Runs) -> str:
    """Judge each claim by the results of `runs`, and return the page of claims and verdicts in Markdown.

    The page also contains the names of the runs and the versions of the program that computed them.
    """
    judgements = [(claim, claim.judge(runs)) for claim in claims]
    counts = Counter(judgement.verdict for _, judgement in judgements)
    verdicts = [f"{verdict} {counts[verdict]}" for verdict in get_args(Verdict) if counts[verdict]]
    rows = [(c.text, c.where, j.measured, f"**{j.verdict}**") for c, j in judgements]
    lines = [
        TITLE,
        f"Verdicts on {len(judgements)} claims: {', '.join(verdicts)}.",
        "",
        "Made by `bayesdamp claims`. Errors are in per cent of the truth: *initial* is the method's own estimate,",
        "*refined* is the trajectory fit that starts there. *Better than claimed* means that an error is more than ten",
        "times, or a time more than three times, below the printed one; such a figure does not confirm the claim.",
        "*Claim* is what the paper states, and *where* the section, equation or figure in which it does.",
        "",
        markdown_table(("claim", "where", "measured", "verdict"), rows),
    ]
    for folder in (runs.paper, *runs.noise):
        if folder is not None:
            code = str(RunFolder(folder).info.get("revision") or "an unknown revision")
            lines += ["", f"Judged by the run `{folder.name}` next to this page, computed by {code}."]
    return "\n".join(lines) + "\n"
