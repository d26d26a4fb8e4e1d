"""All claims, by subject."""

from __future__ import annotations

from bayesdamp.claims import accuracy, coulomb, noise, times, topology
from bayesdamp.claims.judge import Claim

CLAIMS: tuple[Claim, ...] = (
    *topology.CLAIMS,
    *coulomb.CLAIMS,
    *accuracy.CLAIMS,
    *noise.CLAIMS,
    *times.CLAIMS,
)
