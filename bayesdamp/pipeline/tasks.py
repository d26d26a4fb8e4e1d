"""The tasks of a study: their keys, their results, and how these are stored."""

from __future__ import annotations

import hashlib
import json
import os
import time
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from bayesdamp.config import Study
from bayesdamp.outcomes import Status
from bayesdamp.sources import code_digest, reached
from bayesdamp.store import CellResult, Store
from bayesdamp.store.contents import Content
from bayesdamp.store.files import no_room
from bayesdamp.types import OK, InputError, Refusal

_BRANCH = (
    "bayesdamp.pipeline.candidates.branch", "bayesdamp.physics.kernel.march", "bayesdamp.pipeline.records",
    "bayesdamp.interface.fit",
)  # fmt: skip
CODE: dict[str, tuple[str, ...]] = {
    "signal": ("bayesdamp.pipeline.records",),
    "answer": ("bayesdamp.pipeline.answering", "bayesdamp.physics.kernel.march"),
    "envelope": (
        "bayesdamp.pipeline.envelopes", "bayesdamp.interface.envelopes",
        "bayesdamp.inference.envelope.decay", "bayesdamp.inference.envelope.sums",
        "bayesdamp.inference.envelope.posterior", "bayesdamp.records.envelope.record",
        "bayesdamp.report.figures.answer", "bayesdamp.verdict.envelope",
    ),
    "sampled": ("bayesdamp.pipeline.answering", "bayesdamp.physics.kernel.march"),
    "estimate": ("bayesdamp.pipeline.candidates.cells", "bayesdamp.pipeline.records", "bayesdamp.estimators"),
    "mode": (*_BRANCH, "bayesdamp.pipeline.candidates.modes"),
    "posterior": (*_BRANCH, "bayesdamp.pipeline.candidates.posteriors"),
    "evidence": (*_BRANCH, "bayesdamp.pipeline.candidates.weighing"),
    "sensitivity": (*_BRANCH, "bayesdamp.pipeline.candidates.sensitivity"),
    "averaged": ("bayesdamp.pipeline.candidates.weighing",),
    "joint": ("bayesdamp.pipeline.specimens",),
    "population": ("bayesdamp.pipeline.specimens",),
    "calibration": ("bayesdamp.calibrate.ranks", "bayesdamp.calibrate.recovery"),
}  # fmt: skip
"""The modules that compute each kind of task. The source of plug-ins, which are found by name, is added to the parts of
the key."""


@dataclass(frozen=True)
class Product:
    """The result of a task. seconds: of the computation; by default those of the whole task."""

    content: Content | None = None
    arrays: Mapping[str, np.ndarray] = field(default_factory=dict)
    outcome: str = OK
    seconds: float | None = None


Make = Callable[[], Product]


def digest(*parts: object) -> str:
    """Return the SHA-256 of values as JSON."""
    return hashlib.sha256(json.dumps(parts, sort_keys=True, default=str).encode()).hexdigest()


def task_key(kind: str, *parts: object) -> str:
    """Return a key for all that a task's result depends on: the parts, and the code that computes it."""
    return digest(kind, code_digest(*CODE[kind]), *parts)


def uses_library(method: str) -> bool:
    """Return whether an estimator regresses on all damping terms that ship, whichever it is to estimate."""
    return "bayesdamp.estimators.regression.library" in reached([f"bayesdamp.estimators.methods.{method}"])


def cell_seed(study: Study, name: str) -> int:
    """Return the seed of one cell: a function of the study's seed and the cell's name."""
    return int(np.random.SeedSequence([study.seed, zlib.crc32(name.encode())]).generate_state(1)[0])


def perform(store: Store, name: str, key: str, make: Make) -> None:
    """Compute a task and store its result.

    Where the task raises Refusal, its sentence is stored as the outcome; where it fails, the fault. Raises InputError,
    and OSError where the disk is full.
    """
    began = time.perf_counter()

    def write(product: Product) -> None:
        meta = {} if product.content is None else product.content.meta()
        seconds = time.perf_counter() - began if product.seconds is None else product.seconds
        store.write(CellResult(name, key, meta, product.arrays, product.outcome, seconds))

    try:
        write(make())
    except Refusal as refusal:
        write(Product(outcome=str(refusal)))
    except Exception as fault:
        write(Product(outcome=failure(fault)))


def failure(fault: Exception) -> str:
    """Return the outcome that is stored where the program fails in a task.

    Raises the fault again where the input or the disk is wrong, and under BAYESDAMP_DEBUG.
    """
    if isinstance(fault, InputError) or no_room(fault) or os.environ.get("BAYESDAMP_DEBUG"):
        raise fault
    lines = str(fault).strip().splitlines()
    return Status.FAILED.because(f"{type(fault).__name__}: {lines[0] if lines else ''}")
