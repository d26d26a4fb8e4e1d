"""From the numbers of a weighing to a verdict: a typed value, its thresholds in one file, its words in another."""

from bayesdamp.verdict.types import Verdict

__all__ = ["Verdict"]
