"""Judge the claims of the paper by measurements."""

from bayesdamp.claims import accuracy, mechanisms
from bayesdamp.claims.judge import Claim, Judgement, judge_all, write_page

CLAIMS: tuple[Claim, ...] = (*mechanisms.CLAIMS, *accuracy.CLAIMS, *accuracy.IN_NOISE, *accuracy.TIMES)
"""All claims, by subject."""

__all__ = ["CLAIMS", "Claim", "Judgement", "judge_all", "write_page"]
