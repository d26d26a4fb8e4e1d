"""What each estimator says of a candidate on a record, at both of its stages."""

from __future__ import annotations

import time

import numpy as np

from bayesdamp.estimators import run as run_estimator
from bayesdamp.pipeline.candidates.branch import Branch
from bayesdamp.pipeline.records.records import plain_seconds
from bayesdamp.store import CellResult
from bayesdamp.store.contents.estimates import EstimateContent, StageFound
from bayesdamp.store.places import Place
from bayesdamp.types import OK, Problem


def compute_estimate(branch: Branch, name: str, key: str, seed: int) -> None:
    """Store both stages of one estimator, and its curves."""
    began = time.perf_counter()
    method, use = Place.of(name).method, branch.study.estimators
    found = run_estimator(
        use.method(method),
        branch.record.signal,
        Problem(branch.terms, branch.system),
        options=use.options.get(method),
        stages=use.stages,
        seed=seed,
    )
    content = EstimateContent(tuple(map(StageFound.holding, found)))
    trace = {f"{e.stage}/{n}": np.asarray(v) for e in found for n, v in e.trace.items()}
    branch.store.write(CellResult(name, key, content.meta(), trace, OK, plain_seconds(began)))
