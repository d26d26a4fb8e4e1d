"""The stored form of where the search for a law that holds approximately ended, both ways."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from bayesdamp.inference.deviation.candidate import Candidate
from bayesdamp.inference.deviation.data import prepared
from bayesdamp.inference.deviation.single import Found, Single, again
from bayesdamp.inference.deviation.weighing import Friction
from bayesdamp.inference.model.defaults import Reference
from bayesdamp.physics.damping import TERMS
from bayesdamp.priors import prior_of
from bayesdamp.types import Signal


def packed(found: Found) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """What JSON can hold of it, and arrays."""
    meta: dict[str, Any] = {
        "terms": found.terms,
        "reference": [found.reference.amplitude, found.reference.frequency],
        "priors": {n: p.model_dump() for n, p in found.priors.items()},
        "known": dict(found.known),
        "numbers": [found.variance, found.inflation, found.exact_variance, found.epsilon],
        "averaged": found.averaged,
        "frictions": [[f.epsilon, f.weight, f.coefficients.tolist()] for f in found.frictions],
    }
    return meta, {"z": found.z, "u": found.u}


def unpacked(meta: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> Found:
    """What `packed` gave."""
    return Found(
        tuple(meta["terms"]),
        Reference(*meta["reference"]),
        {n: prior_of(p) for n, p in meta["priors"].items()},
        dict(meta["known"]),
        arrays["z"],
        arrays["u"],
        *meta["numbers"],
        frictions=tuple(Friction(e, w, np.array(c)) for e, w, c in meta["frictions"]),
        averaged=bool(meta.get("averaged", False)),
    )


def put_together(signal: Signal, restoring: str, found: Found) -> Single:
    """The candidate on its record, without a search. Raises Refusal where it was found on another record."""
    damping = tuple(t for t in found.terms if TERMS.get(t).parameter in found.priors)
    return again(prepared(signal, found.averaged), Candidate(damping, restoring), found)
