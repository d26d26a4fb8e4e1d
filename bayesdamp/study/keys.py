"""Keys of tasks: inputs, settings, seed, and the source of the code that computes them."""

from __future__ import annotations

import hashlib
import json

from bayesdamp.sources import code_digest, reached

_BRANCH = ("bayesdamp.study.cells", "bayesdamp.study.climbs", "bayesdamp.study.targets")
CODE: dict[str, tuple[str, ...]] = {
    "signal": ("bayesdamp.study.records",),
    "answer": ("bayesdamp.study.answering", "bayesdamp.physics.kernel.march"),
    "fitted": ("bayesdamp.study.law_fits",),
    "noise": ("bayesdamp.study.noise",),
    "estimate": ("bayesdamp.study.cells", "bayesdamp.study.targets", "bayesdamp.estimators"),
    "mode": (
        *_BRANCH, "bayesdamp.inference.checks", "bayesdamp.inference.search", "bayesdamp.inference.seeds",
        "bayesdamp.study.starts",
    ),
    "posterior": (*_BRANCH, "bayesdamp.study.posteriors"),
    "evidence": (*_BRANCH, "bayesdamp.study.weighing"),
    "sensitivity": (*_BRANCH, "bayesdamp.study.sensitivity"),
    "curve": (*_BRANCH, "bayesdamp.study.backbones"),
    "averaged": ("bayesdamp.study.averaging",),
    "joint": ("bayesdamp.study.joining",),
    "population": ("bayesdamp.study.populating",),
    "weighed": ("bayesdamp.study.joining",),
    "calibration": ("bayesdamp.calibration.ranks", "bayesdamp.calibration.recovery"),
}  # fmt: skip
"""What computes each kind of task. What it finds by name is added by the key's maker."""


def digest(*parts: object) -> str:
    """SHA-256 of values as JSON."""
    return hashlib.sha256(json.dumps(parts, sort_keys=True, default=str).encode()).hexdigest()


def task_key(kind: str, *parts: object) -> str:
    """A key for what a task's result depends on: the parts, and the code that computes it."""
    return digest(kind, code_digest(*CODE[kind]), *parts)


def uses_library(method: str) -> bool:
    """Whether an estimator regresses on all damping terms that ship, whichever it is to estimate."""
    return "bayesdamp.estimators.methods._library" in reached([f"bayesdamp.estimators.methods.{method}"])
