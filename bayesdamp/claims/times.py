"""Table 3: how long each method takes."""

from __future__ import annotations

import math
from collections.abc import Callable

from bayesdamp import formatting as fmt
from bayesdamp.claims.judge import NO_RUN, Claim, Judgement, Runs, Verdict
from bayesdamp.report import words
from bayesdamp.report.results.comparing import STAGES

PRINTED = {
    "least_squares": ("< 1 s", 0.0, 1.0),
    "sindy": ("< 1 s", 0.0, 1.0),
    "weak_sindy": ("1–2 s", 1.0, 2.0),
    "envelope": ("2–5 s", 2.0, 5.0),
    "rnn": ("30–60 s", 30.0, 60.0),
    "neural_ode": ("1–2 min", 60.0, 120.0),
    "pinn": ("1–2 min", 60.0, 120.0),
    "genetic": ("2–5 min", 120.0, 300.0),
    "koopman": ("2–3 min", 120.0, 180.0),
    "symbolic_regression": ("5–10 min", 300.0, 600.0),
}
"""By method the time as it is printed, and its ends in s; the lower one is 0 where only the upper one is printed."""
QUICKER = 3.0
"""Factor by which a time below the printed range no longer confirms it: machines differ by as much."""


def verdict_of(own: float, low: float, high: float) -> Verdict:
    """Judge a printed range of time by a measured time, all in s."""
    if not own <= high:
        return "does not hold" if math.isfinite(own) else "cannot be told"
    return "better than claimed" if own < low / QUICKER else "holds"


def _time(method: str) -> Callable[[Runs], Judgement]:
    def judge(runs: Runs) -> Judgement:
        found = runs.compared
        if found is None or method not in found.methods:
            return NO_RUN
        own, refined = (found.seconds.get((method, stage), math.nan) for stage in STAGES)
        measured = (
            f"{fmt.duration(own)} and {fmt.duration(refined)} of refinement for the three records together, "
            "compilation included where it fell due."
        )
        return Judgement(verdict_of(own, *PRINTED[method][1:]), measured)

    return judge


CLAIMS = tuple(
    Claim(f"Table 3, {words.method(method)}: {printed}.", "Table 3", _time(method))
    for method, (printed, _, _) in PRINTED.items()
)
