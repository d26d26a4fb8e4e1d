"""Point estimates of damping: each method's own, and the trajectory fit that starts there."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from pydantic import ValidationError
from threadpoolctl import threadpool_limits

from bayesdamp.estimators._protocol import Estimator, Options, refusal
from bayesdamp.estimators.refine import refine
from bayesdamp.plugins import Registry, nearest
from bayesdamp.types import OK, Estimate, InputError, Problem, Refusal, Signal

ESTIMATORS: Registry[Estimator[Any]] = Registry(
    "bayesdamp.estimators.methods", "estimator", home="bayesdamp.estimators"
)
STAGES = ("initial", "refined")
ELEVEN = (
    "topological", "least_squares", "koopman", "sindy", "weak_sindy", "pinn", "neural_ode", "rnn",
    "symbolic_regression", "envelope", "genetic",
)  # fmt: skip

__all__ = ["ELEVEN", "ESTIMATORS", "STAGES", "Estimator", "Options", "names_for_all", "parse_options", "run"]


def names_for_all() -> list[str]:
    """Return the names that `use = "all"` means, in order; nothing is imported."""
    return list(ELEVEN)


def parse_options(name: str, options: Mapping[str, object] | None, shown: str | None = None) -> Options:
    """Check the options of one estimator.

    Parameters
    ----------
    name
        The estimator.
    options
        Option to value.
    shown
        The name that a study gave the estimator, if it is another one.

    Raises
    ------
    InputError
        If an option is unknown, with the nearest valid name, or if its value is wrong, with what it should be.
    """
    shown = shown or name
    model = ESTIMATORS.get(name).options
    for key in options or {}:
        if key not in model.model_fields:
            valid = list(model.model_fields)
            hint = nearest(str(key), valid) if valid else "; it has none"
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
        The estimator.
    signal
        The record.
    problem
        The damping terms to estimate, and what is known of the system.
    options
        Options of the estimator, by name.
    stages
        Which of `STAGES` to compute.
    seed
        Seed of the estimator's random numbers.

    Returns
    -------
    list of Estimate
        One for each stage, in the order of `STAGES`; `seconds` are those of the stage itself. If a method cannot
        work on the record, its Estimate has no values and the outcome says why. Other exceptions propagate.

    Raises
    ------
    InputError
        If the estimator, an option or a stage is unknown.
    """
    for stage in stages:
        if stage not in STAGES:
            raise InputError(f"unknown stage {stage!r}{nearest(stage, list(STAGES))}")
    estimator, parsed = ESTIMATORS.get(name), parse_options(name, options)
    rng = np.random.default_rng(seed)
    if sentence := refusal(estimator, problem.damping):
        return [Estimate(name, stage, outcome=sentence) for stage in STAGES if stage in stages]

    with threadpool_limits(1, "blas"):  # the matrices are small: more threads would only wait for each other
        first = _timed(name, "initial", lambda: estimator.initial(signal, problem, parsed, rng))
        estimates = [first] if "initial" in stages else []
        if "refined" in stages:
            if first.values:
                estimates.append(_timed(name, "refined", lambda: refine(signal, problem, first)))
            else:
                outcome = f"no initial estimate to refine: {first.outcome}"
                estimates.append(Estimate(name, "refined", outcome=outcome))
    return estimates


def _timed(name: str, stage: str, compute: Callable[[], Estimate]) -> Estimate:
    start = time.perf_counter()
    try:
        estimate = compute()
        bad = [key for key, value in estimate.values.items() if not np.isfinite(value)]
        if bad and estimate.outcome == OK:
            estimate = replace(estimate, values={}, outcome=f"the estimate of {', '.join(bad)} is not finite")
    except Refusal as error:
        estimate = Estimate(name, stage, outcome=str(error))
    return replace(estimate, estimator=name, stage=stage, seconds=time.perf_counter() - start)
