"""Results as `verdict.json` and `verdicts.csv`."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Mapping, Sequence
from typing import Any

from bayesdamp.envelope.pooled import Pooled
from bayesdamp.envelope.results import AtAmplitude, EnvelopeResult, Estimated, Range
from bayesdamp.types import VERDICT_SCHEMA

COLUMNS = (
    "record", "grade", "decided", "damping", "probability", "frequency", "rate", "rate_sd_noise", "rate_sd_law",
    "rate_low", "rate_high", "quality_factor", "quality_factor_sd_noise", "quality_factor_sd_law", "quality_factor_low",
    "quality_factor_high", "exponent", "exponent_low", "exponent_high", "deviation", "deviation_low", "deviation_high",
    "probability_exact", "viscous", "coulomb", "quadratic", "unexplained_pct", "noise_pct", "start", "stop", "sentence",
)  # fmt: skip


def verdict(found: EnvelopeResult) -> dict[str, Any]:
    """One record's object of verdict.json."""
    ranked = sorted(found.probabilities.items(), key=lambda one: -one[1])
    cut = found.cut
    return _finite({
        "schema": VERDICT_SCHEMA,
        "record": found.name,
        "grade": found.grade,
        "decided": found.decided,
        "damping": found.damping or None,
        "probability": found.probability,
        "rivals": [{"damping": name, "probability": p} for name, p in ranked[1:]],
        "terms": dict(found.terms),
        "restoring": None,
        "restoring_probability": None,
        "frequency": None if found.frequency is None else {
            "value": found.frequency, "low": None, "high": None, "unit": "Hz",
        },
        "exponent": _range(found.exponent),
        "rate": None if found.rate is None else {**_estimated(found.rate), "unit": "1/s"},
        "quality_factor": None if found.quality_factor is None else _estimated(found.quality_factor),
        "damping_ratio": _at(found.at, "damping_ratio"),
        "decay_rate": _at(found.at, "rate"),
        "quality_factor_at": _at(found.at, "quality_factor"),
        "energy": [{"term": term, "share": r.value, "low": r.low, "high": r.high} for term, r in found.energy.items()],
        "other_forms": [{"form": "power law", "log_bayes_factor": found.power_law}] if found.exponent else [],
        "deviation": _range(found.deviation),
        "probability_exact": found.probability_exact,
        "unexplained_pct": found.unexplained_pct,
        "noise_pct": found.noise_pct,
        "coefficients": [{"name": c.name, **_estimated(c.estimate), "unit": c.unit} for c in found.coefficients],
        "window": None if cut is None else {
            "start": cut.start, "stop": cut.stop, "cycles": _cycles(found), "why": "; ".join(cut.why),
            "reasons": list(cut.why), "floor_db": cut.floor,
        },
        "remarks": list(found.remarks),
        "sentence": found.sentence,
    })  # fmt: skip


def verdict_json(found: Sequence[EnvelopeResult], pooled: Pooled | None = None) -> bytes:
    """The whole file; a specimen's object stands behind its records'."""
    every = [verdict(one) for one in found]
    if pooled is not None:
        every.append(
            _finite(
                {
                    "schema": VERDICT_SCHEMA,
                    "specimen": pooled.name,
                    **{k: v for k, v in vars(pooled).items() if k != "name"},
                }
            )
        )
    return json.dumps(every, indent=1, ensure_ascii=False, allow_nan=False).encode()


def verdicts_csv(found: Sequence[EnvelopeResult]) -> bytes:
    """A line a record; what is not known is an empty cell. Each other term that was weighed has its column too, behind
    those of viscous, Coulomb and quadratic damping."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    more = dict.fromkeys(term for one in found for term in one.terms if term not in COLUMNS)
    at = COLUMNS.index("quadratic") + 1
    columns = (*COLUMNS[:at], *more, *COLUMNS[at:])
    writer.writerow(columns)
    for one in found:
        cells = _flat(one)
        writer.writerow(["" if cells.get(name) is None else cells[name] for name in columns])
    return text.getvalue().encode()


def _flat(found: EnvelopeResult) -> Mapping[str, Any]:
    cells: dict[str, Any] = {
        "record": found.name,
        "grade": found.grade,
        "decided": str(found.decided).lower(),
        "damping": found.damping,
        "probability": found.probability,
        "frequency": found.frequency,
        "probability_exact": found.probability_exact,
        "unexplained_pct": found.unexplained_pct,
        "noise_pct": found.noise_pct,
        "sentence": found.sentence,
        **found.terms,
    }
    for name in ("rate", "quality_factor", "exponent", "deviation"):
        one = getattr(found, name)
        if one is not None:
            cells |= {name: one.value, f"{name}_low": one.low, f"{name}_high": one.high}
        if isinstance(one, Estimated):
            cells |= {f"{name}_sd_noise": one.sd_noise, f"{name}_sd_law": one.sd_law}
    if found.cut is not None:
        cells |= {"start": found.cut.start, "stop": found.cut.stop}
    return {k: None if isinstance(v, float) and not math.isfinite(v) else v for k, v in cells.items()}


def _range(one: Range | None) -> dict[str, float] | None:
    return None if one is None else {"value": one.value, "low": one.low, "high": one.high}


def _estimated(one: Estimated) -> dict[str, float]:
    return {
        "value": one.value,
        "sd_noise": one.sd_noise,
        "sd_law": one.sd_law,
        "low": one.low,
        "high": one.high,
    }


def _at(found: Sequence[AtAmplitude], what: str) -> list[dict[str, Any]]:
    return [
        {"amplitude": one.amplitude, "unit": one.unit, **_estimated(getattr(one, what))}
        for one in found
        if getattr(one, what) is not None
    ]


def _cycles(found: EnvelopeResult) -> float | None:
    return (
        None
        if found.frequency is None or found.cut is None
        else found.frequency * (found.cut.stop - found.cut.start)
    )


def _finite(value: Any) -> Any:
    """With None for what is not finite: JSON has no other word for it."""
    if isinstance(value, dict):
        return {k: _finite(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(v) for v in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
