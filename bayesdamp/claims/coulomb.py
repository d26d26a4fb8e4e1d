"""Sections 3.4 and 5.3: Coulomb friction and its smoothing."""

from __future__ import annotations

import numpy as np

from bayesdamp.claims.bench import initial_error
from bayesdamp.claims.judge import FAR, Claim, Judgement, Runs


def _tanh(runs: Runs) -> Judgement:
    tanh, sign = (initial_error("sindy", "coulomb", {"switch": s}) for s in ("tanh", "sign"))
    measured = (
        f"One sparse regression, one record: {sign:.2g} % with sign(θ̇), {tanh:.2g} % with tanh(θ̇/ε), ε = 0.1."
    )
    if not (np.isfinite(tanh) and np.isfinite(sign)):
        return Judgement("cannot be told", measured)
    better = tanh < 0.5 * sign
    close = better and 8 < sign < 15 and 1 < tanh < 4
    return Judgement("holds" if close else "holds in part" if better else "does not hold", measured)


def _why(runs: Runs) -> Judgement:
    same = initial_error("least_squares", "coulomb")
    told_sign = initial_error("least_squares", "coulomb", epsilon=0.0)
    both_sign = initial_error("least_squares", "coulomb", made=0.0, epsilon=0.0)
    told_tanh = initial_error("least_squares", "coulomb", made=0.0, epsilon=0.1)
    measured = (
        f"Least squares on a record made with tanh: {same:.2g} % with tanh, {told_sign:.2g} % with sign; on one made "
        f"with sign: {told_tanh:.2g} % with tanh, {both_sign:.2g} % with sign. What matters is that the regression has "
        "the record's own law."
    )
    return Judgement("holds" if told_tanh < both_sign and same < told_sign else "does not hold", measured)


def _regression(runs: Runs) -> Judgement:
    error = initial_error("least_squares", "coulomb")
    verdict = (
        "does not hold" if not error <= 0.006 else "better than claimed" if error * FAR < 0.006 else "holds"
    )
    return Judgement(verdict, f"From the angle alone: {error:.2g} %.")


def _envelope(runs: Runs) -> Judgement:
    smooth, exact = (initial_error("envelope", "coulomb", made=e, epsilon=e) for e in (0.1, 0.0))
    measured = f"Initial error {smooth:.2g} % with ε = 0.1 and {exact:.2g} % with exact friction."
    return Judgement("holds" if max(smooth, exact) < 1 else "does not hold", measured)


CLAIMS = (
    Claim("SINDy: tanh in place of sign takes the Coulomb error from 11 to 2.2 %.", "3.4, 5.3", _tanh),
    Claim("Regression needs the smoothed tanh for Coulomb friction.", "5.3, 6", _why),
    Claim("Least squares on the smoothed term reaches 0.006 %.", "5.3", _regression),
    Claim("Envelope matching is robust to the discontinuity.", "5.3", _envelope),
)
