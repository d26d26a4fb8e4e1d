"""Compute the keys and seeds of tasks, and store the result of a task."""

import hashlib
import json
import os
import time
import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from bayesdamp.config import Study
from bayesdamp.sources import code_digest
from bayesdamp.store.files import is_disk_full
from bayesdamp.store.results import Content, Store, TaskResult
from bayesdamp.types import OK, InputError, Refusal, Status

_CANDIDATE = (
    "bayesdamp.pipeline.candidates.candidate", "bayesdamp.physics.kernel.march", "bayesdamp.pipeline.records",
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
    "estimate": ("bayesdamp.pipeline.candidates.tasks", "bayesdamp.pipeline.records", "bayesdamp.estimators"),
    "mode": (*_CANDIDATE, "bayesdamp.pipeline.candidates.modes"),
    "posterior": (*_CANDIDATE, "bayesdamp.pipeline.candidates.posteriors"),
    "evidence": (*_CANDIDATE, "bayesdamp.pipeline.candidates.evidence"),
    "calibration": ("bayesdamp.calibrate.ranks", "bayesdamp.calibrate.recovery"),
}  # fmt: skip
"""Names of the modules that compute each kind of task. Their source code, with the modules that they import, is part of
the key of the task. Plug-ins are not imported but looked up by name, so their source is added to the key separately."""


@dataclass(frozen=True)
class Product:
    """The result of a computation, before it is stored as the result of a task.

    content: the values; None if there are none. arrays: arrays by name. outcome: `ok`, or a text that says why there is
    no result, or why it is unreliable. seconds: duration of the computation; if None, the measured duration of the task
    is stored.
    """

    content: Content | None = None
    arrays: Mapping[str, np.ndarray] = field(default_factory=dict)
    outcome: str = OK
    seconds: float | None = None


@dataclass(frozen=True)
class Task:
    """A computation of a study whose result is stored.

    name: name of the task, such as `answer/SIGNAL/0`. key: hash of all inputs and of the code. compute: function that
    computes the result but does not store it.
    """

    name: str
    key: str
    compute: Callable[[], Product]


def digest_of(*parts: object) -> str:
    """Return the hexadecimal SHA-256 of values, written as JSON; what JSON cannot represent is converted with `str`."""
    return hashlib.sha256(json.dumps(parts, sort_keys=True, default=str).encode()).hexdigest()


def task_key(kind: str, *parts: object) -> str:
    """Return the key of a task: the hash of its inputs `parts` and of the code for this kind of task (`CODE`)."""
    return digest_of(kind, code_digest(*CODE[kind]), *parts)


def task_seed(study: Study, name: str) -> int:
    """Return the random seed of a task, from 0 to 2³² − 1. It follows from the study's seed and the task's name."""
    return int(np.random.SeedSequence([study.seed, zlib.crc32(name.encode())]).generate_state(1)[0])


def compute_and_store(store: Store, task: Task) -> None:
    """Compute a task, and store its result.

    If the computation raises Refusal, its whole message is stored as the outcome. After other exceptions, the outcome
    is the text from `outcome_of_failure`, which has only the first line of the message. InputError and the OSError of a
    full disk (with BAYESDAMP_DEBUG set, every exception but Refusal) are raised to the caller, and nothing is stored.
    """
    began = time.perf_counter()

    def write(product: Product) -> None:
        meta = {} if product.content is None else product.content.meta()
        seconds = time.perf_counter() - began if product.seconds is None else product.seconds
        store.write(TaskResult(task.name, task.key, meta, product.arrays, product.outcome, seconds))

    try:
        write(task.compute())
    except Refusal as refusal:
        write(Product(outcome=str(refusal)))
    except Exception as fault:
        write(Product(outcome=outcome_of_failure(fault)))


def outcome_of_failure(fault: Exception) -> str:
    """Return the outcome of a task that failed with an exception: "failed: TYPE: FIRST LINE OF THE MESSAGE".

    Raises the exception again if it is an InputError, if the disk is full, or if BAYESDAMP_DEBUG is set.
    """
    if isinstance(fault, InputError) or is_disk_full(fault) or os.environ.get("BAYESDAMP_DEBUG"):
        raise fault
    lines = str(fault).strip().splitlines()
    return Status.FAILED.because(f"{type(fault).__name__}: {lines[0] if lines else ''}")
