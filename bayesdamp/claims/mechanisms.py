"""Claims of the paper on why the topological estimator fails, and on the smoothing of Coulomb friction by tanh.

They are from sections 3.2, 3.4, 5.1, 5.3 and 6 of the paper.
"""

from __future__ import annotations

import math

from bayesdamp.claims.judge import (
    MUCH_SMALLER,
    PENDULUM,
    TRUTH,
    Claim,
    Judgement,
    Runs,
    claim,
    initial_error,
    period_drift,
    verdict_of,
)
from bayesdamp.formatting import digits
from bayesdamp.physics.oscillator import Oscillator

CLAIMS: list[Claim] = []
"""The claims of this module, to which the decorator `claim` appends."""
AS_PRINTED = {"variant": "as_printed"}
"""Options of the topological estimator for the formulas as the paper prints them."""


def _listing(errors: dict[str, float], n: int = 2) -> str:
    """Return errors in per cent, which are given by damping term, as one line of text.

    Each has `n` significant digits, as in "viscous 0.12 %, coulomb 3.4 %".
    """
    return ", ".join(f"{damping} {_per_cent(error, n)}" for damping, error in errors.items())


def _per_cent(error: float, n: int = 2) -> str:
    """Return an error in per cent as text with `n` significant digits, such as "0.12 %"."""
    return f"{digits(error, n=n)} %"


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
    good = max(errors.values()) < 5 and math.isfinite(printed)
    verdict = "holds in part" if good and printed > 10 else "holds" if good else "does not hold"
    return Judgement(verdict, measured)


@claim(CLAIMS, "SINDy: tanh in place of sign reduces the Coulomb error from 11 to 2.2 %.", "3.4, 5.3")
def _tanh_helps_sindy(runs: Runs) -> Judgement:
    tanh, sign = (initial_error("sindy", "coulomb", {"switch": s}) for s in ("tanh", "sign"))
    shown = f"{_per_cent(sign)} with sign(θ̇), {_per_cent(tanh)} with tanh(θ̇/ε), ε = 0.1"
    measured = f"One sparse regression, one record: {shown}."
    if not (math.isfinite(tanh) and math.isfinite(sign)):
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
