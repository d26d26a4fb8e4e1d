"""What each estimator says of a candidate on a record, at both of its stages."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bayesdamp.estimators import run as run_estimator
from bayesdamp.pipeline.candidates.branch import Branch
from bayesdamp.pipeline.tasks import Product
from bayesdamp.store.contents import EstimateContent


def compute_estimate(branch: Branch, method: str, seed: int) -> Product:
    """Both stages of one estimator, and its curves."""
    use = branch.study.estimators
    found = run_estimator(
        use.method(method),
        branch.record.signal,
        branch.case.problem,
        options=use.options.get(method),
        stages=use.stages,
        seed=seed,
    )
    trace = {f"{e.stage}/{n}": np.asarray(v) for e in found for n, v in e.trace.items()}
    return Product(EstimateContent(tuple(replace(e, trace={}) for e in found)), trace)
