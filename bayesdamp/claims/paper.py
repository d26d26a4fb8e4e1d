"""Define the claims of the paper on mechanisms, errors and computing times, and the functions that judge them.

"The paper" compares eleven damping estimators (see `bayesdamp.estimators`). The mechanisms are the reason why the
topological estimator fails, and the smoothing of Coulomb friction by tanh.
"""

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

from bayesdamp import formatting as fmt
from bayesdamp.claims.judge import (
    MUCH_SMALLER,
    NO_RUN,
    PENDULUM,
    TRUTH,
    Claim,
    Judgement,
    Runs,
    Verdict,
    claim,
    initial_error,
    initial_estimate,
    on_clean,
    period_drift,
    verdict_of,
)
from bayesdamp.physics.damping import TERMS
from bayesdamp.physics.oscillator import Oscillator
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
"""All claims that are judged, in the order of the page: mechanisms, errors on records without noise, errors on noisy
records, times. The decorator `claim` appends to it."""
AS_PRINTED = {"variant": "as_printed"}
"""Options of the topological estimator that select the formulas as the paper prints them."""
HYBRID = 0.1
"""Largest error, in per cent of the true coefficient, that the paper claims for hybrid methods: an estimator whose
estimate is refined by a least-squares fit of the trajectory."""
GENERATIONS = (20, 40)
"""Smallest and largest number of generations in which the genetic algorithm converges, as the paper claims."""
LEAST_ERRORS = 20
"""Smallest number of errors whose root mean square is compared with the Cramér–Rao bound. With 20 errors, the relative
standard error of the root mean square is about 1/√(2·20) = 16 % (for Gaussian errors)."""
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


def _listing(errors: dict[str, float], n: int = 2) -> str:
    """Return errors as one line of text, such as "viscous 0.12 %, coulomb 3.4 %".

    errors: errors in per cent, by damping term. n: number of significant digits.
    """
    return ", ".join(f"{damping} {_per_cent(error, n)}" for damping, error in errors.items())


def _per_cent(error: float, n: int = 2) -> str:
    """Return an error in per cent as text with `n` significant digits, such as "0.12 %"."""
    return f"{fmt.digits(error, n=n)} %"


@claim(
    CLAIMS, "Topological methods fail where the restoring force is nonlinear (77.6, 31.0, 20.0 %).", "3.2, 6"
)
def _topological_fails(runs: Runs) -> Judgement:
    published = {d: initial_error("topological", d) for d in TRUTH}
    printed = {d: initial_error("topological", d, AS_PRINTED) for d in TRUTH}
    measured = (
        f"The method as first published, on the same records: {_listing(published)}. With the paper's formulas: "
        f"{_listing(printed, 3)}."
    )
    return Judgement("holds" if min(published.values()) > 10 else "does not hold", measured)


@claim(CLAIMS, "The cause of the failure is the nonlinear restoring force.", "3.2.5, 5.1")
def _nonlinearity_is_the_cause(runs: Runs) -> Judgement:
    frequency = Oscillator(("viscous",), "horizontal_pendulum").natural_frequency(PENDULUM, 0.0)
    unit = 100 * (1 - 1 / frequency)
    pendulum = initial_error("topological", "viscous", AS_PRINTED)
    spring = initial_error("topological", "viscous", AS_PRINTED, restoring="linear")
    measured = (
        f"The error of the printed formula is {pendulum:.2f} % on the pendulum and {spring:.2f} % on a linear spring "
        f"with the same stiffness, where nothing is nonlinear. 1 − 1/ω_n is {unit:.2f} %: the formula gives a ratio, "
        "but ζ in the equation of motion is a rate."
    )
    return Judgement("holds" if spring < 0.1 * pendulum else "does not hold", measured)


@claim(CLAIMS, "The frequency changes by about 0.6 % as the amplitude decays.", "3.2.5, eq. 14, 26")
def _frequency_drifts(runs: Runs) -> Judgement:
    drift = {d: period_drift(d) for d in TRUTH}
    measured = (
        f"Difference between the mean periods in the two halves of the record: {_listing(drift)}. Equation (14) is "
        "the equation for a force proportional to sin θ."
    )
    return Judgement("holds" if max(drift.values()) > 0.3 else "does not hold", measured)


@claim(CLAIMS, "The topological method works well for linear systems.", "3.2.6")
def _topological_works_on_springs(runs: Runs) -> Judgement:
    errors = {d: initial_error("topological", d, restoring="linear") for d in TRUTH}
    printed = initial_error("topological", "viscous", AS_PRINTED, restoring="linear")
    measured = (
        f"Linear spring, as first published: {_listing(errors)}. With the paper's formula, the viscous error "
        f"is {_per_cent(printed, 3)}."
    )
    good = max(errors.values()) < 5 and np.isfinite(printed)
    verdict = "holds in part" if good and printed > 10 else "holds" if good else "does not hold"
    return Judgement(verdict, measured)


@claim(CLAIMS, "SINDy: tanh in place of sign reduces the Coulomb error from 11 to 2.2 %.", "3.4, 5.3")
def _tanh_helps_sindy(runs: Runs) -> Judgement:
    tanh, sign = (initial_error("sindy", "coulomb", {"switch": s}) for s in ("tanh", "sign"))
    shown = f"{_per_cent(sign)} with sign(θ̇), {_per_cent(tanh)} with tanh(θ̇/ε), ε = 0.1"
    measured = f"One sparse regression, one record: {shown}."
    if not (np.isfinite(tanh) and np.isfinite(sign)):
        return Judgement("cannot be judged", measured)
    better = tanh < 0.5 * sign
    close = better and 8 < sign < 15 and 1 < tanh < 4
    return Judgement("holds" if close else "holds in part" if better else "does not hold", measured)


@claim(CLAIMS, "Regression needs the smoothed tanh for Coulomb friction.", "5.3, 6")
def _regression_needs_tanh(runs: Runs) -> Judgement:
    tanh, tanh_as_sign, sign, sign_as_tanh = (
        initial_error("least_squares", "coulomb", simulated=simulated, assumed=assumed)
        for simulated, assumed in ((0.1, 0.1), (0.1, 0.0), (0.0, 0.0), (0.0, 0.1))
    )
    measured = (
        f"Least squares on a record simulated with tanh: {_per_cent(tanh)} with tanh, {_per_cent(tanh_as_sign)} with "
        f"sign; on one simulated with sign: {_per_cent(sign_as_tanh)} with tanh, {_per_cent(sign)} with sign. The "
        "regression must use the friction law (tanh or sign) with which the record was simulated."
    )
    return Judgement("holds" if sign_as_tanh < sign and tanh < tanh_as_sign else "does not hold", measured)


@claim(CLAIMS, "Least squares on the smoothed term reaches 0.006 %.", "5.3")
def _regression_is_accurate(runs: Runs) -> Judgement:
    error = initial_error("least_squares", "coulomb")
    verdict = verdict_of(error, 0.006, 0.006, MUCH_SMALLER)
    return Judgement(verdict, f"From the angle alone: {_per_cent(error)}.")


@claim(CLAIMS, "Envelope matching is robust to the discontinuity.", "5.3")
def _envelope_is_robust(runs: Runs) -> Judgement:
    smooth, exact = (initial_error("envelope", "coulomb", simulated=e, assumed=e) for e in (0.1, 0.0))
    measured = f"Initial error {_per_cent(smooth)} with ε = 0.1 and {_per_cent(exact)} with exact friction."
    return Judgement("holds" if max(smooth, exact) < 1 else "does not hold", measured)


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

    The printed errors are those in `comparison.published`. Initial estimates are those before the trajectory fit,
    refined estimates those after it. The verdict is

    - "cannot be judged" if `comparison` does not contain the estimator,
    - "better than claimed" if every initial error is smaller than the printed one by more than the factor
      `MUCH_SMALLER` (printed zeros are left out),
    - "holds" if no initial error is larger than the printed one,
    - "holds in part" if only the refined errors meet these same printed errors (none is larger),
    - "does not hold" otherwise.

    For "holds" and "holds in part", a printed error counts as at least 0.005 %. A missing error does not confirm a
    claim.
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
    worst = comparison.at_stage("initial").loc[names].fillna(np.inf).max(axis=1)
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
    """Return the errors of a method's initial estimates at one noise level, by the number of the repeat.

    The errors are absolute, in per cent of the true value. level: the noise in per cent of the first amplitude. The
    result is {} if there are no errors or if the level is not one of `along.values`.
    """
    return along.of(method, "initial", along.values.index(level)) if level in along.values else {}


def _size(along: ErrorSeries, method: str, level: float) -> str:
    """Return the root mean square error of a method's initial estimates at one noise level as text.

    It is in per cent of the true value, such as "2.1 % (1.5 to 2.9)"; the 95 % interval is included if at least three
    repeats have an estimate. level: the noise in per cent of the first amplitude, one of `along.values`.
    """
    low, high = error_interval(_errors(along, method, level))
    error = along.errors.at[(method, "initial"), along.values.index(level)]
    interval = f" ({fmt.digits(low, n=2)} to {fmt.digits(high, n=2)})" if np.isfinite(low) else ""
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
    together. The verdict is "holds" if it is in the printed range or below it by at most the factor `MUCH_FASTER`,
    "better than claimed" if it is even shorter, "does not hold" if it is above the range, and "cannot be judged" if
    `comparison` does not contain the estimator or its time.
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
