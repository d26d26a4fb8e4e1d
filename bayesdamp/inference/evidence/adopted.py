"""Which of several log evidences of one model counts, and when nested sampling decides."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from bayesdamp.types import OK, Evidence

NESTED_CHECK = "nested"
APART = 3.0
"""Largest difference of two methods, in combined standard errors."""
COMBINED = "combined"
"""Name, as a method, of the log evidence that counts."""


def disagreement(evidences: Sequence[Evidence]) -> str:
    """Return why nested sampling has to decide, in words; nothing where all methods are trusted and agree."""
    poor = [e.method for e in evidences if e.outcome != OK]
    if poor:
        return f"the diagnostic of {' and '.join(poor)} is poor"
    for first, second in combinations(evidences, 2):
        error = float(np.hypot(first.stderr, second.stderr))
        apart = abs(first.log_evidence - second.log_evidence) / error if error > 0 else np.inf
        if not apart < APART:
            return f"{first.method} and {second.method} are {apart:.1f} standard errors apart"
    return ""


def adopted(evidences: Sequence[Evidence]) -> Evidence:
    """Return the log evidence that counts, from one or more of one model.

    It is that of nested sampling where this was used and is trusted, or else the mean of the trusted methods by inverse
    variance. The outcome says where no method is trusted, or where these disagree.
    """
    if not any(np.isfinite(e.log_evidence) for e in evidences):
        return replace(evidences[0], method=COMBINED)
    others = [e for e in evidences if e.method != NESTED_CHECK]
    why = disagreement(others)
    for e in evidences:
        if e.method == NESTED_CHECK and e.outcome == OK:
            reason = f"nested sampling counts: {why}" if why else "nested sampling counts"
            return replace(e, method=COMBINED, diagnostic=reason)
    trusted = [e for e in others if e.outcome == OK]
    if not trusted:
        best = min(evidences, key=lambda e: e.stderr if np.isfinite(e.stderr) else np.inf)
        return replace(best, method=COMBINED, diagnostic=why, outcome=f"not settled: {why}")
    weights = np.array([e.stderr**-2 for e in trusted])
    names = " and ".join(e.method for e in trusted)
    split = disagreement(trusted) if len(trusted) > 1 else ""
    outcome = f"not settled: {split}" if split else OK
    return replace(
        trusted[0],
        method=COMBINED,
        log_evidence=float(weights @ [e.log_evidence for e in trusted] / weights.sum()),
        stderr=float(weights.sum() ** -0.5),
        diagnostic=f"{names} agree" if len(trusted) > 1 and outcome == OK else f"by {names}",
        outcome=outcome,
    )
