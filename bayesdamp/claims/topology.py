"""Section 3.2 and 5.1: why the topological method fails, and whether it does."""

from __future__ import annotations

import math

from bayesdamp.claims.bench import PENDULUM, TRUTH, initial_error, period_drift
from bayesdamp.claims.judge import Claim, Judgement, Runs
from bayesdamp.physics.oscillator import Oscillator

PRINTED = {"viscous": 77.6, "coulomb": 31.0, "quadratic": 20.0}
AS_PRINTED = {"variant": "as_printed"}


def _fails(runs: Runs) -> Judgement:
    published = {d: initial_error("topological", d) for d in TRUTH}
    printed = {d: initial_error("topological", d, AS_PRINTED) for d in TRUTH}
    said = ", ".join(f"{d} {published[d]:.2g} %" for d in TRUTH)
    formulas = ", ".join(f"{d} {printed[d]:.3g} %" for d in TRUTH)
    measured = (
        f"The method as first published, on the same records: {said}. With the paper's formulas: {formulas}."
    )
    return Judgement("holds" if min(published.values()) > 10 else "does not hold", measured)


def _unit(runs: Runs) -> Judgement:
    frequency = Oscillator(("viscous",), "horizontal_pendulum").natural_frequency(PENDULUM, 0.0)
    unit = 100 * (1 - 1 / frequency)
    pendulum = initial_error("topological", "viscous", AS_PRINTED)
    spring = initial_error("topological", "viscous", AS_PRINTED, restoring="linear")
    measured = (
        f"The printed formula misses by {pendulum:.2f} % on the pendulum and by {spring:.2f} % on a linear spring of "
        f"the same stiffness, where nothing is nonlinear. 1 − 1/ω_n is {unit:.2f} %: it gives a ratio where the "
        "equation's ζ is a rate."
    )
    blamed = spring < 0.1 * pendulum
    return Judgement("holds" if blamed else "does not hold", measured)


def _drift(runs: Runs) -> Judgement:
    drift = {d: period_drift(d) for d in TRUTH}
    said = ", ".join(f"{d} {v:.2g} %" for d, v in drift.items())
    measured = (
        f"Mean period of the record's first half against its second: {said}. Equation (14) is that of sin θ."
    )
    return Judgement("holds" if max(drift.values()) > 0.3 else "does not hold", measured)


def _linear(runs: Runs) -> Judgement:
    errors = {d: initial_error("topological", d, restoring="linear") for d in TRUTH}
    said = ", ".join(f"{d} {e:.2g} %" for d, e in errors.items())
    printed = initial_error("topological", "viscous", AS_PRINTED, restoring="linear")
    measured = (
        f"Linear spring, as first published: {said}; with the paper's formula, viscous: {printed:.3g} %."
    )
    good = max(errors.values()) < 5 and math.isfinite(printed)
    return Judgement(
        "holds in part" if good and printed > 10 else "holds" if good else "does not hold", measured
    )


CLAIMS = (
    Claim(
        "Topological methods fail where the restoring force is nonlinear (77.6, 31.0, 20.0 %).",
        "3.2, 6",
        _fails,
    ),
    Claim("The cause of the failure is the nonlinear restoring force.", "3.2.5, 5.1", _unit),
    Claim("The frequency changes by about 0.6 % as the amplitude decays.", "3.2.5, eq. 14, 26", _drift),
    Claim("The topological method works well for linear systems.", "3.2.6", _linear),
)
