"""What a task of a study leaves, and how it is stored."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from bayesdamp.outcomes import Status
from bayesdamp.store import CellResult, Store
from bayesdamp.store.contents import Content
from bayesdamp.store.files import no_room
from bayesdamp.types import OK, InputError, Refusal


@dataclass(frozen=True)
class Product:
    """What a task leaves. seconds: of the computation, where another than the whole task's is told."""

    content: Content | None = None
    arrays: Mapping[str, np.ndarray] = field(default_factory=dict)
    outcome: str = OK
    seconds: float | None = None


Make = Callable[[], Product]


def perform(store: Store, name: str, key: str, make: Make) -> None:
    """Compute a task and store its product; where it raises Refusal, the sentence, and where it fails, what went wrong.

    Raises InputError, and OSError where the disk is full.
    """
    began = time.perf_counter()

    def keep(product: Product) -> None:
        meta = {} if product.content is None else product.content.meta()
        seconds = time.perf_counter() - began if product.seconds is None else product.seconds
        store.write(CellResult(name, key, meta, product.arrays, product.outcome, seconds))

    try:
        keep(make())
    except Refusal as refusal:
        keep(Product(outcome=str(refusal)))
    except Exception as fault:
        keep(Product(outcome=failure(fault)))


def failure(fault: Exception) -> str:
    """Return what is stored of a fault of the program in a task. Raises it again where it is the input's or the disk's,
    and under BAYESDAMP_DEBUG."""
    if isinstance(fault, InputError) or no_room(fault) or os.environ.get("BAYESDAMP_DEBUG"):
        raise fault
    lines = str(fault).strip().splitlines()
    return Status.FAILED.because(f"{type(fault).__name__}: {lines[0] if lines else ''}")
