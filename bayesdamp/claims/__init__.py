"""The claims of the paper, each with a measurement that supports or contradicts it."""

from bayesdamp.claims import accuracy, mechanisms
from bayesdamp.claims.judge import Claim, Judgement, judged, written

CLAIMS: tuple[Claim, ...] = (*mechanisms.CLAIMS, *accuracy.CLAIMS, *accuracy.IN_NOISE, *accuracy.TIMES)
"""All claims, by subject."""

__all__ = ["CLAIMS", "Claim", "Judgement", "judged", "written"]
