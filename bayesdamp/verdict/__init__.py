"""Decide on a verdict: `decide` decides, `thresholds` has every threshold, `words` writes the sentences."""

from bayesdamp.verdict.types import Verdict

__all__ = ["Verdict"]
