"""Estimate the damping coefficients of a recorded oscillation, with one of several methods, in two stages.

The first stage is the method's own estimate. The second stage is a least-squares fit of the solution of the equation of
motion (the trajectory) to the record; it starts from this estimate.

In the docstrings of this package, "the paper" is: A Comparative Study of Machine Learning and Classical Methods for
Damping Parameter Estimation in Nonlinear Oscillatory Systems. It compares eleven methods on pendulums with viscous,
Coulomb or quadratic damping; docs/methods.md describes what we do differently.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from pydantic import ValidationError
from threadpoolctl import threadpool_limits

from bayesdamp.estimators.refine import refine
from bayesdamp.estimators.shared import (
    Estimator,
    Options,
    checked_features,
    oscillator,
    reason_not_applicable,
)
from bayesdamp.physics.oscillator import reference_of
from bayesdamp.plugins import Registry, nearest
from bayesdamp.types import OK, Estimate, InputError, Problem, Refusal, Signal

ESTIMATORS: Registry[Estimator[Any]] = Registry(
    "bayesdamp.estimators.methods", "estimator", home="bayesdamp.estimators"
)
"""All estimators by name: those that ship with bayesdamp and those that a user adds."""
STAGES = ("initial", "refined")
"""The two stages of an estimator: "initial" is the method's own estimate, "refined" a least-squares fit of the motion
to the record that starts from this estimate."""
__all__ = ["ESTIMATORS", "STAGES", "Estimator", "Options", "names_for_all", "parse_options", "run"]


def names_for_all() -> list[str]:
    """Return the names of the estimators that `use = "all"` in a study file selects.

    They are the eleven methods that the paper compares (its title is in the docstring of `bayesdamp.estimators`).
    """
    return [
        "topological", "least_squares", "koopman", "sindy", "weak_sindy", "pinn", "neural_ode", "rnn",
        "symbolic_regression", "envelope", "genetic",
    ]  # fmt: skip


def parse_options(name: str, options: Mapping[str, object] | None, shown: str | None = None) -> Options:
    """Check the options of one estimator, and return them with defaults for those that are missing.

    Parameters
    ----------
    name
        Name of the estimator.
    options
        Values by the name of the option; None to use only defaults.
    shown
        The name of the estimator's table in the study file, for messages; by default `name`.

    Returns
    -------
    Options
        The options, with defaults for those that are not given.

    Raises
    ------
    InputError
        If the estimator or an option is unknown, or the value of an option is wrong.
    """
    shown = shown or name
    model = ESTIMATORS.get(name).options
    for key in options or {}:
        if key not in model.model_fields:
            valid = list(model.model_fields)
            hint = nearest(str(key), valid) if valid else "; this estimator has no options"
            raise InputError(f"[estimators.{shown}] has no option {key!r}{hint}")
    try:
        return model.model_validate(dict(options or {}))
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"])
        raise InputError(f"[estimators.{shown}] {key} = {first['input']!r}: {first['msg']}") from None


def run(
    name: str,
    signal: Signal,
    problem: Problem,
    *,
    options: Mapping[str, object] | None = None,
    stages: Sequence[str] = STAGES,
    seed: int | Sequence[int] | np.random.SeedSequence,
) -> list[Estimate]:
    """Apply one estimator to one record.

    Parameters
    ----------
    name
        Name of the estimator.
    signal
        The record.
    problem
        The damping terms to estimate, and the known parameters of the system.
    options
        Options of the estimator, by name; None to use only defaults.
    stages
        The stages to return, "initial", "refined" or both. For "refined" alone, the initial estimate is computed but
        not returned.
    seed
        Seed of the estimator's random numbers.

    Returns
    -------
    list of Estimate
        An estimate for each stage in `stages`, in the order of `STAGES`. It has no values, and its outcome is the
        reason, if the method cannot be applied to the record, if it gives no value of a damping coefficient, if a value
        is not finite although the outcome would be OK, or if there is no initial estimate to refine. Exceptions other
        than Refusal propagate.

    Raises
    ------
    InputError
        If the estimator, an option, a stage, a damping term or the restoring law is unknown, the value of an option is
        wrong, or no oscillation is possible with the known restoring parameters.
    """
    for stage in stages:
        if stage not in STAGES:
            raise InputError(f"unknown stage {stage!r}{nearest(stage, list(STAGES))}")
    estimator, parsed = ESTIMATORS.get(name), parse_options(name, options)
    rng = np.random.default_rng(seed)
    if reason := reason_not_applicable(estimator, problem.damping):
        return [Estimate(name, stage, outcome=reason) for stage in STAGES if stage in stages]

    def initial() -> Estimate:
        reference_of(problem.system, checked_features(signal))  # InputError if no oscillation is possible
        estimate = estimator.initial(signal, problem, parsed, rng)
        missing = [n for n in oscillator(problem).coefficients if n not in estimate.values]
        if missing and (estimate.values or estimate.outcome == OK):
            raise Refusal(f"the estimator gave no value of {', '.join(missing)}")
        return estimate

    with threadpool_limits(1, "blas"):  # the matrices are small, so more threads only make it slower
        first = _timed(name, "initial", initial)
        estimates = [first] if "initial" in stages else []
        if "refined" in stages:
            estimates.append(_timed(name, "refined", lambda: refine(signal, problem, first)))
    return estimates


def _timed(name: str, stage: str, compute: Callable[[], Estimate]) -> Estimate:
    """Call `compute` and return its estimate with the estimator's name, the stage and the duration in s.

    The estimate has no values, and its outcome is the reason, if `compute` raises Refusal, or if it returns the outcome
    OK with a value that is not finite.
    """
    start = time.perf_counter()
    try:
        estimate = compute()
        bad = [key for key, value in estimate.values.items() if not np.isfinite(value)]
        if bad and estimate.outcome == OK:
            estimate = replace(estimate, values={}, outcome=f"the estimate of {', '.join(bad)} is not finite")
    except Refusal as error:
        estimate = Estimate(name, stage, outcome=str(error))
    return replace(estimate, estimator=name, stage=stage, seconds=time.perf_counter() - start)
