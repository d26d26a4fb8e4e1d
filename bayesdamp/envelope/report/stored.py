"""Results out of `verdict.json`, as far as a page shows them."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

from bayesdamp.envelope.pooled import Pooled
from bayesdamp.envelope.results import AtAmplitude, Cut, EnvelopeResult, Estimated, Range

_PARTS = ("value", "low", "high", "sd_noise", "sd_law")


def read_verdicts(text: str) -> tuple[list[EnvelopeResult], Pooled | None]:
    """The records' results and the specimen's. Raises KeyError, TypeError or ValueError for what is no such file."""
    every = json.loads(text)
    found = [_result(one) for one in every if "record" in one]
    specimens = [one for one in every if "specimen" in one]
    if not specimens:
        return found, None
    given = {k: v for k, v in specimens[0].items() if k not in ("schema", "specimen")}
    return found, Pooled(name=specimens[0]["specimen"], **given)


def _result(one: Mapping[str, Any]) -> EnvelopeResult:
    probabilities = {one["damping"]: one["probability"]} if one["damping"] else {}
    window = one["window"]
    cut = None
    if window is not None:
        cut = Cut(window["start"], window["stop"], 0, 0, tuple(window["reasons"]), math.nan)
    quality = one["quality_factor_at"] or [None] * len(one["decay_rate"])
    return EnvelopeResult(
        one["record"],
        one["grade"],
        one["sentence"],
        decided=one["decided"],
        damping=one["damping"] or "",
        probability=_number(one["probability"]),
        probabilities=probabilities | {rival["damping"]: rival["probability"] for rival in one["rivals"]},
        terms=one["terms"],
        rate=None if one["rate"] is None else _estimated(one["rate"]),
        at=tuple(
            AtAmplitude(
                rate["amplitude"], rate["unit"], _estimated(rate), None, None if q is None else _estimated(q)
            )
            for rate, q in zip(one["decay_rate"], quality, strict=True)
        ),
        exponent=None if one["exponent"] is None else _range(one["exponent"]),
        quality_factor=None if one["quality_factor"] is None else _estimated(one["quality_factor"]),
        cut=cut,
        remarks=tuple(one["remarks"]),
    )


def _estimated(one: Mapping[str, Any]) -> Estimated:
    return Estimated(*(_number(one[part]) for part in _PARTS))


def _range(one: Mapping[str, Any]) -> Range:
    return Range(*(_number(one[part]) for part in _PARTS[:3]))


def _number(value: float | None) -> float:
    return math.nan if value is None else float(value)
