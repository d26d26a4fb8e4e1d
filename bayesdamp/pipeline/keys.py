"""Keys of tasks: inputs, settings, seed, and the source of the code that computes them."""

from __future__ import annotations

import hashlib
import json

from bayesdamp.sources import code_digest, reached

_BRANCH = (
    "bayesdamp.pipeline.candidates.branch",
    "bayesdamp.physics.kernel.march",
    "bayesdamp.pipeline.records.targets",
)
CODE: dict[str, tuple[str, ...]] = {
    "signal": ("bayesdamp.pipeline.records.records",),
    "answer": ("bayesdamp.pipeline.records.answering", "bayesdamp.physics.kernel.march"),
    "envelope": (
        "bayesdamp.pipeline.envelopes", "bayesdamp.interface.envelopes",
        "bayesdamp.inference.envelope.decay", "bayesdamp.inference.envelope.sums",
        "bayesdamp.records.envelope.reading", "bayesdamp.report.figures.envelope",
    ),
    "sampled": ("bayesdamp.pipeline.records.answering", "bayesdamp.physics.kernel.march"),
    "estimate": ("bayesdamp.pipeline.candidates.estimates", "bayesdamp.pipeline.records.targets"),
    "mode": (*_BRANCH, "bayesdamp.pipeline.candidates.modes"),
    "posterior": (*_BRANCH, "bayesdamp.pipeline.candidates.posteriors"),
    "evidence": (*_BRANCH, "bayesdamp.pipeline.candidates.weighing"),
    "sensitivity": (*_BRANCH, "bayesdamp.pipeline.candidates.sensitivity"),
    "averaged": ("bayesdamp.pipeline.candidates.averaging",),
    "joint": ("bayesdamp.pipeline.many.joining",),
    "population": ("bayesdamp.pipeline.many.populating",),
    "calibration": ("bayesdamp.calibrate.ranks", "bayesdamp.calibrate.recovery"),
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
    return "bayesdamp.estimators.regression.library" in reached([f"bayesdamp.estimators.methods.{method}"])
