"""The stored form of where the search for a law that holds approximately ended, both ways."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from bayesdamp.inference.deviation.candidate import Candidate
from bayesdamp.inference.deviation.data import prepared
from bayesdamp.inference.deviation.single import Found, Single, again
from bayesdamp.inference.deviation.weighing import Friction
from bayesdamp.inference.model.defaults import Reference
from bayesdamp.inference.noise._residuals import FittedNoise
from bayesdamp.physics.damping import TERMS
from bayesdamp.priors import prior_of
from bayesdamp.store.contents.answers import FoundFriction, LawContent, WeighedNoise
from bayesdamp.store.contents.records import Scales
from bayesdamp.types import Signal

NUMBERS = ("variance", "inflation", "exact_variance", "epsilon", "averaged")
"""What is stored as it is."""


def packed(found: Found) -> tuple[LawContent, dict[str, np.ndarray]]:
    """What a cell keeps of it, and its arrays."""
    content = LawContent(
        terms=found.terms,
        reference=Scales(found.reference.amplitude, found.reference.frequency),
        priors={n: p.model_dump() for n, p in found.priors.items()},
        known=dict(found.known),
        frictions=tuple(map(packed_friction, found.frictions)),
        noise=WeighedNoise(found.noise.name, found.noise.log_evidence, found.noise.values),
        **{k: getattr(found, k) for k in NUMBERS},
    )
    arrays = {"z": found.z, "u": found.u}
    return content, arrays if found.working is None else {**arrays, "working": found.working}


def packed_friction(friction: Friction) -> FoundFriction:
    """Return a width of friction as a cell keeps it."""
    coefficients, further = (tuple(one.tolist()) for one in (friction.coefficients, friction.further))
    return FoundFriction(friction.epsilon, friction.weight, coefficients, further)


def unpacked(content: LawContent, arrays: Mapping[str, np.ndarray]) -> Found:
    """What `packed` gave."""
    return Found(
        terms=content.terms,
        reference=Reference(content.reference.amplitude, content.reference.frequency),
        priors={n: prior_of(p) for n, p in content.priors.items()},
        known=content.known,
        z=arrays["z"],
        u=arrays["u"],
        noise=FittedNoise(content.noise.noise, content.noise.values, content.noise.log_evidence),
        working=arrays.get("working"),
        frictions=tuple(
            Friction(f.epsilon, f.weight, np.array(f.coefficients), np.array(f.further))
            for f in content.frictions
        ),
        **{k: getattr(content, k) for k in NUMBERS},
    )


def put_together(signal: Signal, restoring: str, found: Found) -> Single:
    """The candidate on its record, without a search. Raises Refusal where it was found on another record."""
    damping = tuple(t for t in found.terms if TERMS.get(t).parameter in found.priors)
    return again(prepared(signal, found.averaged), Candidate(damping, restoring), found)
