"""One factor at a time: which simulated signals differ from a base in their noise, sampling or length alone."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass
from typing import Any

from bayesdamp.report.results.comparing import STAGES, rms, true_models
from bayesdamp.report.results.reading import damping_parameters
from bayesdamp.report.results.run import Run

FACTORS = {
    "noise": "noise / % of the first amplitude",
    "sampling": "samples a period",
    "length": "periods",
}
LEAST = 3
"""Values of a factor that make a series."""


@dataclass(frozen=True)
class Series:
    """Errors along one factor under one damping.

    values: of the factor, ascending; signals: that have it; errors: (method, stage) to the root mean square
    error in per cent of the truth at each value; answers: how many repeats had an answer, and of how many;
    bounds: the Cramér–Rao bound in per cent, nan where there is none; each: (method, stage) to the error of every
    repeat that had an answer, by its number, at each value.
    """

    model: str
    factor: str
    values: list[float]
    signals: list[str]
    errors: dict[tuple[str, str], list[float]]
    answers: dict[tuple[str, str], list[tuple[int, int]]]
    bounds: list[float]
    each: dict[tuple[str, str], list[dict[int, float]]]


def series(run: Run) -> list[Series]:
    """Every series of at least three values that the run holds, by damping and factor."""
    places = {signal: _place(run, signal) for signal in true_models(run)}
    found = []
    for model in dict.fromkeys(true_models(run).values()):
        own = {s: p for s, p in places.items() if p is not None and true_models(run)[s] == model}
        if len(own) < LEAST:
            continue
        base = tuple(Counter(p[i] for p in own.values()).most_common(1)[0][0] for i in range(len(FACTORS)))
        for i, factor in enumerate(FACTORS):
            along = {
                s: p[i] for s, p in own.items() if all(p[j] == base[j] for j in range(len(base)) if j != i)
            }
            if len(set(along.values())) >= LEAST:
                signals = sorted(along, key=lambda s: along[s])
                found.append(_series(run, model, factor, signals, [along[s] for s in signals]))
    return found


def _place(run: Run, signal: str) -> tuple[float, float, float] | None:
    """Noise in per cent of the first amplitude, samples a period and periods, rounded to two digits."""
    about = run.about(signal)
    source: dict[str, Any] = next(
        (s.get("source") or {} for s in run.study.get("signals") or [] if s["name"] == signal), {}
    )
    rate = ((run.info.get("equilibrium") or {}).get(signal) or {}).get("natural_frequency")
    truth, amplitude = source.get("truth") or {}, (about.get("reference") or {}).get("amplitude")
    if not rate or not amplitude or not source.get("duration"):
        return None
    periods = source["duration"] * rate / (2 * math.pi)
    start = abs(truth.get("theta0") or amplitude)
    numbers = (100 * truth.get("noise_sd", 0.0) / start, (source["samples"] - 1) / periods, periods)
    return tuple(float(f"{x:.2g}") for x in numbers)  # type: ignore[return-value]


def _series(run: Run, model: str, factor: str, signals: list[str], values: list[float]) -> Series:
    damping = set(damping_parameters(run).values())
    found: dict[tuple[str, str], list[dict[int, float]]] = {}
    tried: Counter[tuple[str, str, str]] = Counter()
    for row in run.estimates:
        if row["model"] != model or row["signal"] not in signals or row["stage"] not in STAGES:
            continue
        key = (row["estimator"], row["stage"])
        if row["parameter"] in damping or not row["parameter"]:
            tried[(*key, row["signal"])] += 1
        if row["parameter"] in damping and math.isfinite(row["error_pct"]):
            places = found.setdefault(key, [{} for _ in signals])
            places[signals.index(row["signal"])][int(row["repeat"])] = row["error_pct"]
    errors = {key: [rms(own.values()) for own in places] for key, places in found.items()}
    answers = {
        key: [(len(own), tried[(*key, s)]) for own, s in zip(places, signals)]
        for key, places in found.items()
    }
    bounds = [_bound(run, s, model) for s in signals]
    return Series(model, factor, values, signals, errors, answers, bounds, found)


def _bound(run: Run, signal: str, model: str) -> float:
    """The bound on the damping coefficient in per cent of its true value, for a single damping."""
    found, damping = run.about(signal).get("bound") or {}, set(damping_parameters(run).values())
    for row in run.estimates:
        if row["signal"] == signal and row["parameter"] in found and row["parameter"] in damping:
            bound, truth = found[row["parameter"]], row["truth"]
            if truth and isinstance(bound, (int, float)) and math.isfinite(bound):
                return 100 * bound / abs(truth)
    return math.nan
