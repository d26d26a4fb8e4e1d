"""What a task of a study leaves, and how it is stored."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from bayesdamp.store import CellResult, Store
from bayesdamp.store.contents.content import Content
from bayesdamp.types import OK, Refusal


@dataclass(frozen=True)
class Product:
    """What a task leaves. seconds: of the computation, where another than the whole task's is told."""

    content: Content | None = None
    arrays: Mapping[str, np.ndarray] = field(default_factory=dict)
    outcome: str = OK
    seconds: float | None = None


Make = Callable[[], Product]


def perform(store: Store, name: str, key: str, make: Make) -> None:
    """Compute a task and store its product; where it raises Refusal, the sentence."""
    began = time.perf_counter()
    try:
        product = make()
    except Refusal as refusal:
        product = Product(outcome=str(refusal))
    meta = {} if product.content is None else product.content.meta()
    seconds = time.perf_counter() - began if product.seconds is None else product.seconds
    store.write(CellResult(name, key, meta, product.arrays, product.outcome, seconds))
