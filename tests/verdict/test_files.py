"""verdict.json and verdicts.csv have one shape, whatever the record holds of the motion."""

from __future__ import annotations

import csv
import json
import math
from dataclasses import fields, is_dataclass, replace
from enum import StrEnum
from pathlib import Path
from types import NoneType
from typing import Any, get_args, get_type_hints

import numpy as np
import pytest

from bayesdamp.interface.envelopes import analyse
from bayesdamp.records.envelope.record import make_record
from bayesdamp.verdict import Verdict
from bayesdamp.verdict.types import columns, load_verdicts, save_verdicts
from tests.verdict.test_decide import HERTZ, decided, findings


def faults(kind: Any, value: Any, at: str = "verdict") -> list[str]:
    """What of a JSON value is not as a type has it; a number that is not known is null."""
    each = get_args(kind)
    if value is None:
        return [] if kind is float or NoneType in each else [f"{at}: null"]
    if isinstance(value, list):
        return [text for i, one in enumerate(value) for text in faults(each[0], one, f"{at}[{i}]")]
    one = each[0] if each else kind
    if is_dataclass(one):
        hints = {f.name: get_type_hints(one)[f.name] for f in fields(one)}
        given = {k: v for k, v in value.items() if k != "schema"}
        found = [f"{at}.{name}: missing" for name in hints.keys() - given]
        found += [f"{at}.{name}: unknown" for name in given.keys() - hints]
        for name in hints.keys() & given:
            found += faults(hints[name], given[name], f"{at}.{name}")
        return found
    expected = {float: (int, float)}.get(one, str if issubclass(one, StrEnum) else one)
    right = isinstance(value, expected) and isinstance(value, bool) == (one is bool)
    return [] if right else [f"{at}: {value!r} is no {one.__name__}"]


@pytest.fixture(scope="module")
def envelope() -> Verdict:
    t = 12.0 * np.arange(10.0)
    y = 3.0 * 0.5 ** (t / 12.0) * np.exp(0.02 * np.random.default_rng(2).standard_normal(t.size))
    return analyse(make_record("swing.csv", t, y, "mm", 2.0)).verdict


def test_an_envelope_and_a_motion_have_one_schema(envelope: Verdict, tmp_path: Path) -> None:
    motion = replace(decided(findings(frequency_at=HERTZ)), unexplained_pct=math.nan)
    save_verdicts(tmp_path, [motion, envelope])
    for one in json.loads((tmp_path / "verdict.json").read_text(), parse_constant=pytest.fail):
        assert one.pop("schema") == 1
        assert faults(Verdict, one) == []
    loaded = load_verdicts(tmp_path / "verdict.json")
    assert [v.to_dict() for v in loaded] == [motion.to_dict(), envelope.to_dict()]
    rows = list(csv.DictReader((tmp_path / "verdicts.csv").read_text().splitlines()))
    assert [row["quantity"] for row in rows] == ["angle", "envelope"]
    assert tuple(rows[0]) == columns()
    for row, v in zip(rows, (motion, envelope), strict=True):
        assert float(row["ratio_1"]) == v.damping_ratio[0].value
        assert [float(row[s.term]) for s in v.energy] == [s.probability for s in v.energy]
    assert float(rows[1]["quality_factor"]) == envelope.quality_factor.value
    assert (rows[0]["quality_factor"], rows[1]["restoring"]) == ("", "")


def test_another_shape_is_seen(envelope: Verdict) -> None:
    """The negative control; the first is what an envelope's object once had."""
    cases = [
        ({"terms": {"viscous": 0.9}}, "verdict.terms: unknown"),
        ({"probability": "0.9"}, "verdict.probability: '0.9' is no float"),
        ({"damping": None}, "verdict.damping: null"),
        ({"rate": {"value": 0.1}}, "verdict.rate.low: missing"),
    ]
    for change, said in cases:
        assert said in faults(Verdict, {**envelope.to_dict(), **change})
