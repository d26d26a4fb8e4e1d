"""Claims on the errors of estimators on records without and with noise, on convergence, and on computing times.

They are from sections 3 to 6, tables 2 and 3, and figure 10 of the paper.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

from bayesdamp import formatting as fmt
from bayesdamp.claims.judge import (
    MUCH_SMALLER,
    NO_RUN,
    TRUTH,
    Claim,
    Judgement,
    Runs,
    Verdict,
    claim,
    initial_error,
    initial_estimate,
    on_clean,
    verdict_of,
)
from bayesdamp.physics.damping import TERMS
from bayesdamp.report import words
from bayesdamp.report.results.estimators import (
    STAGES,
    ErrorSeries,
    EstimatorComparison,
    error_interval,
    is_significantly_better,
    printed_error,
    rank_ranges,
    rms,
)

CLAIMS: list[Claim] = []
"""The claims of this module, to which the decorator `claim` appends."""
HYBRID = 0.1
"""Largest error, in per cent of the true coefficient, that the paper claims for hybrid methods: an estimator whose
estimate is refined by a least-squares fit of the trajectory."""
GENERATIONS = (20, 40)
"""Smallest and largest number of generations in which the genetic algorithm converges, as the paper claims."""
LEAST_ERRORS = 20
"""Smallest number of errors whose root mean square is compared with the Cramér–Rao bound. Its relative standard error
is then about 1/√(2·20) = 16 % (for Gaussian errors)."""
PRINTED_ERRORS = {
    "least_squares": "0.0004 / 0.006 / 0.001",
    "koopman": "~0",
    "sindy": "0.15 / 2.2 / 0.24",
    "pinn": "0.15 / 0.41 / 0.06",
    "neural_ode": "0.11 / 0.04 / 0.04",
    "rnn": "0.01 / 0.07 / 0.01",
    "symbolic_regression": "0.15 / 0.39 / 0.07",
    "weak_sindy": "0.15 / 0.39 / 0.07",
    "envelope": "0.03 / 0.04 / 0.03",
    "genetic": "~0",
}
"""Relative errors of the estimated coefficient in per cent (viscous / Coulomb / quadratic record) by estimator, as
printed in the paper's table 2. A single value applies to all three records."""
PRINTED_TIMES = {
    "least_squares": ("< 1 s", 0.0, 1.0),
    "sindy": ("< 1 s", 0.0, 1.0),
    "weak_sindy": ("1–2 s", 1.0, 2.0),
    "envelope": ("2–5 s", 2.0, 5.0),
    "rnn": ("30–60 s", 30.0, 60.0),
    "neural_ode": ("1–2 min", 60.0, 120.0),
    "pinn": ("1–2 min", 60.0, 120.0),
    "genetic": ("2–5 min", 120.0, 300.0),
    "koopman": ("2–3 min", 120.0, 180.0),
    "symbolic_regression": ("5–10 min", 300.0, 600.0),
}
"""Computing times by estimator: as printed in the paper's table 3, and the lower and upper limit in s. The lower limit
is 0 if the paper prints only an upper one."""


@claim(CLAIMS, "Hybrid methods (an estimate, then the trajectory fit) reach errors below 0.1 %.", "3.1, 5.2")
@on_clean
def _hybrid(comparison: EstimatorComparison) -> Judgement:
    initial, refined = (comparison.at_stage(stage) for stage in STAGES)
    worst, worst_refined = initial.max(axis=1), refined.max(axis=None)
    good = [words.method(m) for m in comparison.methods if (initial.loc[m] < HYBRID).all()]
    measured = (
        f"Every refined estimate is within {fmt.digits(worst_refined, n=1)} % of the truth, because the trajectory fit "
        "has a single optimum, which does not depend on its start. The largest error without this fit is "
        f"{fmt.digits(worst.max(), n=2)} % ({words.method(worst.idxmax())}), and {fmt.listing(good) or 'none'} "
        f"{'is' if len(good) == 1 else 'are'} below 0.1 % without it. The error after the refinement therefore does "
        "not show how good the method before it is."
    )
    return Judgement("holds" if worst_refined < HYBRID else "does not hold", measured)


def _row(method: str, comparison: EstimatorComparison) -> Judgement:
    """Judge the errors that the paper's table 2 prints for one estimator, by the measured errors in `comparison`.

    "holds" if the initial estimates (before the trajectory fit) reach every printed error, "holds in part" if only the
    refined estimates do, else "does not hold"; a printed error counts as at least 0.005 %, and a missing one is never
    reached. "better than claimed" if every initial error is smaller than the printed one by more than the factor
    `MUCH_SMALLER`, printed zeros left out. "cannot be judged" if `comparison` does not contain the estimator.
    """
    if method not in comparison.methods:
        return NO_RUN
    printed = [printed_error(text) for text in comparison.published.loc[method]]
    errors = {stage: comparison.at_stage(stage).loc[method].tolist() for stage in STAGES}
    # A printed 0 means below the last printed digit. Comparisons with nan are false, so nan does not confirm a claim.
    own, refined = (all(e <= max(p, 5e-3) for e, p in zip(errors[stage], printed)) for stage in STAGES)
    pairs = [(p, e) for p, e in zip(printed, errors["initial"]) if p > 0]
    verdict: Verdict = "holds" if own else "holds in part" if refined else "does not hold"
    if pairs and all(e * MUCH_SMALLER < p for p, e in pairs):
        verdict = "better than claimed"
    sizes = "; ".join(f"{s} {' / '.join(fmt.number(e, 2) for e in errors[s])}" for s in STAGES)
    tail = " Only the refined estimates reach the printed errors." if refined and not own else ""
    return Judgement(verdict, f"Viscous / Coulomb / quadratic: {sizes} %.{tail}")


CLAIMS.extend(
    Claim(f"Table 2, {words.method(m)}: {printed} %.", "Table 2", on_clean(partial(_row, m)))
    for m, printed in PRINTED_ERRORS.items()
)


@claim(CLAIMS, "All iterative methods (PINN, neural ODE, genetic) come within 0.5 %.", "Figure 10")
@on_clean
def _iterative(comparison: EstimatorComparison) -> Judgement:
    names = ["pinn", "neural_ode", "genetic"]
    if not set(names) <= set(comparison.methods):
        return NO_RUN
    worst = comparison.at_stage("initial").loc[names].fillna(math.inf).max(axis=1)
    sizes = ", ".join(f"{words.method(m)} {fmt.digits(e, n=2)} %" for m, e in worst.items())
    verdict = "holds" if worst.max() < 0.5 else "does not hold"
    return Judgement(verdict, f"Largest error of each initial estimate: {sizes}.")


@claim(CLAIMS, "The genetic algorithm converges in 20 to 40 generations.", "4.5")
def _generations(runs: Runs) -> Judgement:
    generations = {}
    for damping, truth in TRUTH.items():
        details: Mapping[str, Any] = initial_estimate("genetic", damping).details
        course = details.get("course", {}).get(TERMS.get(damping).parameter, [])
        away = np.flatnonzero(np.abs(np.asarray(course) / truth - 1) > 0.01)
        generations[damping] = int(away[-1]) + 1 if away.size else 0
    counts, most = ", ".join(f"{d} {n}" for d, n in generations.items()), max(generations.values())
    measured = (
        f"Generations until the best one stays within 1 %: {counts}. The search range follows from the decay of the "
        "record."
    )
    return Judgement(verdict_of(most, *GENERATIONS), measured)


@claim(CLAIMS, "PINNs converge when they start from a direct estimate.", "4.5")
def _pinn(runs: Runs) -> Judgement:
    errors = {s: initial_error("pinn", "viscous", {"start": s}) for s in ("uninformed", "direct")}
    sizes = ", ".join(f"{fmt.digits(e, n=2)} % from the {s} start" for s, e in errors.items())
    good = errors["direct"] < 1
    tail = " It converges without the direct start too." if good and errors["uninformed"] < 1 else ""
    return Judgement("holds" if good else "does not hold", f"Viscous: {sizes}.{tail}")


@claim(CLAIMS, "Clean data, known model: least squares is the fastest and below 0.01 %.", "5.5")
@on_clean
def _best_clean(comparison: EstimatorComparison) -> Judgement:
    means = comparison.at_stage("initial").mean(axis=1).dropna().sort_values(kind="stable")
    seconds = comparison.seconds["initial"][means.index]
    fastest = seconds.idxmin()
    sizes = ", ".join(f"{words.method(m)} {fmt.digits(mean, n=1)} %" for m, mean in means.head(4).items())
    measured = (
        f"Mean initial error, best first: {sizes}. Least squares takes {fmt.duration(seconds.get('least_squares'))} "
        f"for the three records; the fastest is {words.method(fastest)}."
    )
    parts = (fastest == "least_squares") + bool(means.reindex(["least_squares"]).iloc[0] < 0.01)
    return Judgement(("does not hold", "holds in part", "holds")[parts], measured)


def _errors(along: ErrorSeries, method: str, level: float) -> dict[int, float]:
    """Return the errors of a method's initial estimates at a noise level in per cent of the first amplitude.

    The errors are absolute, in per cent of the true value, by the number of the repeat; {} if there are none, or if the
    level is not one of `along.values`.
    """
    return along.of(method, "initial", along.values.index(level)) if level in along.values else {}


def _size(along: ErrorSeries, method: str, level: float) -> str:
    """Return the root mean square error of a method's initial estimates at a noise level as text.

    It is in per cent of the true value, with its 95 % interval if at least three repeats have an estimate. The level,
    in per cent of the first amplitude, is one of `along.values`. An example is "2.1 % (1.5 to 2.9)".
    """
    low, high = error_interval(_errors(along, method, level))
    error = along.errors.at[(method, "initial"), along.values.index(level)]
    interval = f" ({fmt.digits(low, n=2)} to {fmt.digits(high, n=2)})" if math.isfinite(low) else ""
    return f"{fmt.digits(error, n=2)} %{interval}"


@claim(CLAIMS, "Noisy data: use weak SINDy.", "5.5")
def _weak(runs: Runs) -> Judgement:
    parts, best, worst = [], [], []
    for along in runs.along_noise:
        for level in (1.0, 10.0):
            if not _errors(along, "weak_sindy", level):
                continue
            order = rank_ranges(along, "initial", along.values.index(level))
            first, last = order["weak_sindy"]
            best.append(first)
            worst.append(last)
            leading = min(order, key=lambda m: along.errors.at[(m, "initial"), along.values.index(level)])
            rank = f"rank {first}" if first == last else f"rank {first} to {last}"
            parts.append(
                f"{words.model(along.model)} at {fmt.digits(level)} %: {rank} of {len(order)}, "
                f"{_size(along, 'weak_sindy', level)}; smallest {words.method(leading)} {_size(along, leading, level)}"
            )
    if not parts:
        return NO_RUN
    verdict = "holds" if max(worst) <= 2 else "does not hold" if min(best) > 2 else "holds in part"
    measured = f"Initial estimates, with the range of ranks that the repeats allow: {'; '.join(parts)}."
    return Judgement(verdict, measured)


@claim(CLAIMS, "In noise, the weak form is better than SINDy because it uses no derivative.", "3.9")
def _sindy(runs: Runs) -> Judgement:
    better, parts = [], []
    for along in runs.along_noise:
        for level in (1.0, 3.0, 10.0):
            weak, strong = (_errors(along, m, level) for m in ("weak_sindy", "sindy"))
            if not weak or not strong:
                continue
            better.append(is_significantly_better(weak, strong))
            worse = is_significantly_better(strong, weak)
            result = "better" if better[-1] else "worse" if worse else "not significantly different"
            pair = f"{_size(along, 'weak_sindy', level)} against {_size(along, 'sindy', level)}"
            parts.append(f"{words.model(along.model)} {fmt.digits(level)} %: {pair}, {result}")
    if not better:
        return NO_RUN
    verdict = "holds" if all(better) else "holds in part" if any(better) else "does not hold"
    return Judgement(verdict, f"Weak SINDy against SINDy: {'; '.join(parts)}.")


@claim(CLAIMS, "Hybrid methods are the most accurate in noise too.", "5.2, 6")
def _bound(runs: Runs) -> Judgement:
    parts, good = [], []
    for along in runs.along_noise:
        bounds = along.each.index.get_level_values("value").map(dict(enumerate(along.bounds)))
        refined = (along.each / bounds).xs("refined", level="stage").dropna()
        ratios = refined.groupby("estimator").agg([rms, "size"])
        ratios = ratios["rms"][ratios["size"] >= LEAST_ERRORS]
        if ratios.size:
            good.append(ratios.max() < 1.5)
            parts.append(f"{words.model(along.model)} {ratios.min():.2f} to {ratios.max():.2f}")
    if not parts:
        return NO_RUN
    measured = (
        f"Root mean square error of refined estimates divided by the Cramér–Rao bound: {'; '.join(parts)}."
    )
    return Judgement("holds" if all(good) else "does not hold", measured)


def _time(method: str, comparison: EstimatorComparison) -> Judgement:
    """Judge the computing time that the paper's table 3 prints for one estimator, by the measured time.

    The measured time is that of the initial estimates (without the trajectory fit) on all records of `comparison`
    together. "holds" if it is in the printed range or below it by at most the factor `MUCH_FASTER`, "better than
    claimed" if it is still less, "does not hold" if it is above the range, and "cannot be judged" if `comparison` does
    not contain the estimator or its time.
    """
    if method not in comparison.methods:
        return NO_RUN
    own, refined = (float(comparison.seconds.at[method, stage]) for stage in STAGES)
    measured = (
        f"{fmt.duration(own)}, and {fmt.duration(refined)} for the refinement, for the three records together, "
        "including compilation if it was necessary."
    )
    return Judgement(verdict_of(own, *PRINTED_TIMES[method][1:]), measured)


CLAIMS.extend(
    Claim(f"Table 3, {words.method(m)}: {printed}.", "Table 3", on_clean(partial(_time, m)))
    for m, (printed, _, _) in PRINTED_TIMES.items()
)
