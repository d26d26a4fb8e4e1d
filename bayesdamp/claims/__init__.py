"""The claims of the paper, each with a measurement that bears on it."""

from bayesdamp.claims.judge import Claim, Judgement, judged, written
from bayesdamp.claims.known import CLAIMS

__all__ = ["CLAIMS", "Claim", "Judgement", "judged", "written"]
