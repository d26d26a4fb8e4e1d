"""Turn the numbers of a weighing into a verdict: typed values, all thresholds in one file, sentences in another."""

from bayesdamp.verdict.types import Verdict

__all__ = ["Verdict"]
