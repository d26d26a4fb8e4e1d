"""Estimators beside each other and beside published figures: the errors under the model of the truth."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterable
from dataclasses import dataclass

from bayesdamp.report.results.reading import damping_parameters
from bayesdamp.report.results.run import Row, Run
from bayesdamp.types import OK

STAGES = ("initial", "refined")
CATEGORIES = {
    "classical": ("topological", "least_squares", "koopman"),
    "machine learning": (
        "sindy",
        "weak_sindy",
        "pinn",
        "neural_ode",
        "rnn",
        "symbolic_regression",
    ),
    "optimisation": ("envelope", "genetic"),
}
"""The paper's three categories (Table 2)."""


@dataclass(frozen=True)
class Comparison:
    """Errors in per cent of the truth, by (estimator, signal, stage), each the root mean square over repeats.

    methods in the order of the categories; signals: the simulated ones; published: (estimator, signal) to the
    printed error; times: estimator to the printed time; seconds: by (estimator, stage), summed over signals.
    """

    methods: list[str]
    signals: list[str]
    errors: dict[tuple[str, str, str], float]
    outcomes: dict[tuple[str, str, str], str]
    seconds: dict[tuple[str, str], float]
    published: dict[tuple[str, str], str]
    times: dict[str, str]

    def mean(self, method: str, stage: str) -> float:
        """Return the mean error over the signals where the method has one; nan where it has none."""
        return _mean(self.errors.get((method, s, stage), math.nan) for s in self.signals)

    def mean_published(self, method: str) -> float:
        """Return the same of the published figures."""
        return _mean(value(self.published.get((method, s), "")) for s in self.signals)


def _mean(errors: Iterable[float]) -> float:
    finite = [e for e in errors if math.isfinite(e)]
    return sum(finite) / len(finite) if finite else math.nan


def value(printed: str) -> float:
    """A printed error as a number: `~0` is 0, nothing is nan."""
    found = re.search(r"\d+(\.\d+)?", printed)
    return float(found[0]) if found else math.nan


def category(method: str) -> str:
    """The paper's category of a method; "others" for one that it does not have."""
    return next((name for name, members in CATEGORIES.items() if method in members), "others")


def true_models(run: Run) -> dict[str, str]:
    """Simulated signals and the damping that they were made with."""
    found = {}
    for signal in run.study.get("signals") or []:
        source = signal.get("source") if isinstance(signal, dict) else None
        damping = (source or {}).get("damping")
        if damping:
            found[signal["name"]] = "+".join(damping)
    return found


def compared(run: Run) -> Comparison:
    """The comparison over the signals that have published figures, or else over all simulated ones."""
    printed = run.study.get("published") or []
    truths = true_models(run)
    with_figures = {p["signal"] for p in printed}
    signals = [s for s in run.signals if s in truths and (s in with_figures or not with_figures)]
    rows: dict[tuple[str, str, str], list[Row]] = {}
    seconds: dict[tuple[str, str], float] = {}
    seen: set[tuple[str, str, str, int]] = set()
    for row in run.estimates:
        signal = row["signal"]
        if signal not in signals or row["model"] != truths[signal] or row["stage"] not in STAGES:
            continue
        rows.setdefault((row["estimator"], signal, row["stage"]), []).append(row)
        one = (row["estimator"], signal, row["stage"], row["repeat"])
        if one not in seen and math.isfinite(row["seconds"]):
            seen.add(one)
            key = (row["estimator"], row["stage"])
            seconds[key] = seconds.get(key, 0.0) + row["seconds"]
    damping = set(damping_parameters(run).values())
    own = {
        key: [r["error_pct"] for r in found if r["parameter"] in damping and math.isfinite(r["error_pct"])]
        for key, found in rows.items()
    }
    errors = {key: rms(sizes) for key, sizes in own.items() if sizes}
    outcomes = {
        key: next((r["outcome"] for r in found if r["outcome"] != OK), OK) for key, found in rows.items()
    }
    return Comparison(
        in_order(key[0] for key in rows),
        signals,
        errors,
        outcomes,
        seconds,
        {(p["estimator"], p["signal"]): p["error_pct"] for p in printed},
        {p["estimator"]: p["time"] for p in printed if p["time"]},
    )


def rms(errors: Collection[float]) -> float:
    """Return the root mean square; nan of none."""
    return math.sqrt(sum(e * e for e in errors) / len(errors)) if errors else math.nan


def in_order(methods: Iterable[str]) -> list[str]:
    """Return methods in the order of their categories; those of none behind them."""
    order = [m for members in CATEGORIES.values() for m in members]
    return sorted(dict.fromkeys(methods), key=lambda m: order.index(m) if m in order else len(order))
