"""The claims of the paper, each with a measurement that supports or contradicts it."""

from bayesdamp.claims import accuracy, mechanisms, noise
from bayesdamp.claims.judge import Claim, Judgement, judged, written

CLAIMS: tuple[Claim, ...] = (*mechanisms.CLAIMS, *accuracy.CLAIMS, *noise.CLAIMS, *accuracy.TIMES)
"""All claims, by subject."""

__all__ = ["CLAIMS", "Claim", "Judgement", "judged", "written"]
