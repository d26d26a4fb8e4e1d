"""Which of several log evidences of one model counts, and when nested sampling is called to decide."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from bayesdamp.types import OK, Evidence

REFEREE = "nested"
APART = 3.0
"""Combined standard errors by which two methods may differ."""
COMBINED = "combined"
"""Name, as a method, of the log evidence that counts."""


def quarrel(found: Sequence[Evidence]) -> str:
    """Why a referee is needed, in words; nothing where all methods are trusted and agree."""
    poor = [e.method for e in found if e.outcome != OK]
    if poor:
        return f"the diagnostic of {' and '.join(poor)} is poor"
    for i, one in enumerate(found):
        for other in found[i + 1 :]:
            apart = standard_errors(one, other)
            if not apart < APART:
                return f"{one.method} and {other.method} are {apart:.1f} standard errors apart"
    return ""


def standard_errors(one: Evidence, other: Evidence) -> float:
    """How far two log evidences are apart, in standard errors of their difference."""
    error = float(np.hypot(one.stderr, other.stderr))
    return abs(one.log_evidence - other.log_evidence) / error if error > 0 else np.inf


def counted(found: Sequence[Evidence]) -> Evidence:
    """The log evidence that counts: the referee's where it was called and is trusted; else, of the methods that are
    trusted, the mean by inverse variance. Where none is, or these disagree, the outcome says so.

    found: one or more, of one model.
    """
    if not any(np.isfinite(e.log_evidence) for e in found):
        return replace(found[0], method=COMBINED)
    why = quarrel([e for e in found if e.method != REFEREE])
    for e in found:
        if e.method == REFEREE and e.outcome == OK:
            said = f"nested sampling counts: {why}" if why else "nested sampling counts"
            return replace(e, method=COMBINED, diagnostic=said)
    trusted = [e for e in found if e.outcome == OK and e.method != REFEREE]
    if not trusted:
        best = min(found, key=lambda e: e.stderr if np.isfinite(e.stderr) else np.inf)
        return replace(best, method=COMBINED, diagnostic=why, outcome=f"not settled: {why}")
    weights = np.array([e.stderr**-2 for e in trusted])
    names = " and ".join(e.method for e in trusted)
    outcome = OK if len(trusted) < 2 or not (split := quarrel(trusted)) else f"not settled: {split}"
    one = trusted[0]
    return replace(
        one,
        method=COMBINED,
        log_evidence=float(weights @ [e.log_evidence for e in trusted] / weights.sum()),
        stderr=float(weights.sum() ** -0.5),
        diagnostic=f"{names} agree" if len(trusted) > 1 and outcome == OK else f"by {names}",
        outcome=outcome,
    )
