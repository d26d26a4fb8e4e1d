"""All claims, by subject."""

from __future__ import annotations

from bayesdamp.validation.claims import accuracy, coulomb, noise, times, topology
from bayesdamp.validation.claims.judge import Claim

CLAIMS: tuple[Claim, ...] = (
    *topology.CLAIMS,
    *coulomb.CLAIMS,
    *accuracy.CLAIMS,
    *noise.CLAIMS,
    *times.CLAIMS,
)
