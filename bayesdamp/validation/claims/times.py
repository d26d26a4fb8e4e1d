"""Table 3: how long each method takes."""

from __future__ import annotations

import math
import re
from collections.abc import Callable

from bayesdamp import formatting as fmt
from bayesdamp.report import words
from bayesdamp.report.results.comparing import STAGES
from bayesdamp.validation.claims.judge import NO_RUN, Claim, Judgement, Runs, Verdict

PRINTED = {
    "least_squares": "< 1 s",
    "sindy": "< 1 s",
    "weak_sindy": "1–2 s",
    "envelope": "2–5 s",
    "rnn": "30–60 s",
    "neural_ode": "1–2 min",
    "pinn": "1–2 min",
    "genetic": "2–5 min",
    "koopman": "2–3 min",
    "symbolic_regression": "5–10 min",
}


QUICKER = 3.0
"""Factor by which a time below the printed range no longer confirms it: machines differ by as much."""


def seconds(printed: str) -> tuple[float, float]:
    """The ends of a printed range of time, s; the lower is 0 where only the upper is printed."""
    unit = 60.0 if "min" in printed else 1.0
    numbers = [float(n) * unit for n in re.findall(r"\d+(?:\.\d+)?", printed)]
    if not numbers:
        return (math.nan, math.nan)
    return (numbers[0] if len(numbers) > 1 else 0.0, numbers[-1])


def verdict_of(own: float, printed: str) -> Verdict:
    """What a measured time in s says of a printed one."""
    low, high = seconds(printed)
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
        return Judgement(verdict_of(own, PRINTED[method]), measured)

    return judge


CLAIMS = tuple(
    Claim(f"Table 3, {words.method(method)}: {printed}.", "Table 3", _time(method))
    for method, printed in PRINTED.items()
)
