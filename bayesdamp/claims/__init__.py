"""The claims of the paper, each with a measurement that bears on it."""

from bayesdamp.claims import accuracy, coulomb, noise, times, topology
from bayesdamp.claims.judge import Claim, Judgement, judged, written

CLAIMS: tuple[Claim, ...] = (
    *topology.CLAIMS,
    *coulomb.CLAIMS,
    *accuracy.CLAIMS,
    *noise.CLAIMS,
    *times.CLAIMS,
)
"""All claims, by subject."""

__all__ = ["CLAIMS", "Claim", "Judgement", "judged", "written"]
