"""Table 3: how long each method takes."""

from __future__ import annotations

import math
import re
from collections.abc import Callable

from bayesdamp.report import words
from bayesdamp.report.results.comparing import STAGES
from bayesdamp.validation.claims.judge import NO_RUN, Claim, Judgement, Runs

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


def seconds(printed: str) -> float:
    """The upper end of a printed time, s."""
    numbers = re.findall(r"\d+(?:\.\d+)?", printed)
    return float(numbers[-1]) * (60.0 if "min" in printed else 1.0) if numbers else math.nan


def _time(method: str) -> Callable[[Runs], Judgement]:
    def judge(runs: Runs) -> Judgement:
        found = runs.compared
        if found is None or method not in found.methods:
            return NO_RUN
        own, refined = (found.seconds.get((method, stage), math.nan) for stage in STAGES)
        measured = (
            f"{words.duration(own)} and {words.duration(refined)} of refinement for the three records together, "
            "compilation included where it fell due."
        )
        return Judgement("holds" if own <= seconds(PRINTED[method]) else "does not hold", measured)

    return judge


CLAIMS = tuple(
    Claim(f"Table 3, {words.method(method)}: {printed}.", "Table 3", _time(method))
    for method, printed in PRINTED.items()
)
