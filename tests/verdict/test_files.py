"""verdict.json and verdicts.csv have the same fields for a record of the motion and for one of its envelope."""

import csv
import json
import math
from dataclasses import astuple, fields, is_dataclass, replace
from enum import StrEnum
from pathlib import Path
from types import NoneType
from typing import Any, get_args, get_type_hints

import numpy as np
import pytest

from bayesdamp.interface.envelopes import analyse
from bayesdamp.records.envelope.record import make_record
from bayesdamp.types import VERDICT_SCHEMA, InputError
from bayesdamp.verdict import Verdict
from bayesdamp.verdict.types import columns, load_verdicts, save_verdicts
from tests.verdict.test_decide import HERTZ, verdict_of


def type_faults(kind: Any, value: Any, place: str = "verdict") -> list[str]:
    """Return where a JSON value differs from a type. A number that is not known is null."""
    arguments = get_args(kind)
    if value is None:
        return [] if kind is float or NoneType in arguments else [f"{place}: null"]
    if isinstance(value, list):
        return [f for i, item in enumerate(value) for f in type_faults(arguments[0], item, f"{place}[{i}]")]
    expected = arguments[0] if arguments else kind
    if is_dataclass(expected):
        names = {f.name for f in fields(expected)}
        faults = [f"{place}.{name}: missing or unknown" for name in names ^ value.keys()]
        hints = get_type_hints(expected)
        for name in names & value.keys():
            faults += type_faults(hints[name], value[name], f"{place}.{name}")
        return faults
    plain = {float: (int, float)}.get(expected, str if issubclass(expected, StrEnum) else expected)
    is_right = isinstance(value, plain) and isinstance(value, bool) == (expected is bool)
    return [] if is_right else [f"{place}: {value!r} is not of type {expected.__name__}"]


@pytest.fixture(scope="module")
def envelope() -> Verdict:
    t = 12.0 * np.arange(10.0)
    y = 3.0 * 0.5 ** (t / 12.0) * np.exp(0.02 * np.random.default_rng(2).standard_normal(t.size))
    return analyse(make_record("swing.csv", t, y, "mm", 2.0)).verdict


def test_an_envelope_and_a_motion_have_the_same_fields(envelope: Verdict, tmp_path: Path) -> None:
    motion = replace(verdict_of(frequency_at=HERTZ), unexplained_pct=math.nan)
    save_verdicts(tmp_path, [motion, envelope])
    content = json.loads((tmp_path / "verdict.json").read_text(), parse_constant=pytest.fail)
    assert [v.pop("schema") for v in content] == [3, 3]
    assert [type_faults(Verdict, v) for v in content] == [[], []]
    loaded = load_verdicts(tmp_path / "verdict.json")
    assert [repr(astuple(v)) for v in loaded] == [repr(astuple(v)) for v in (motion, envelope)]
    rows = list(csv.DictReader((tmp_path / "verdicts.csv").read_text().splitlines()))
    assert [row["quantity"] for row in rows] == ["angle", "envelope"]
    assert [name for name in rows[0] if name != "cubic"] == list(columns())
    for row, v in zip(rows, (motion, envelope), strict=True):
        assert float(row["ratio_1"]) == v.damping_ratio[0].value
        assert [float(row[s.term]) for s in v.energy] == [s.probability for s in v.energy]
        shares = [f"{s.term}:{s.share:.4g}({s.low:.4g},{s.high:.4g})" for s in v.energy]
        rivals = [f"{r.damping}:{r.probability:.4g}" for r in v.rivals]
        assert (row["energy"].split(), row["rivals"].split()) == (shares, rivals)
    sizes = [float(rows[1][name]) for name in ("quality_factor", "cycles")]
    assert sizes == [envelope.quality_factor.value, envelope.window.cycles]
    assert (rows[0]["quality_factor"], rows[1]["restoring"]) == ("", "")


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        ({"terms": {"viscous": 0.9}}, "verdict.terms: missing or unknown"),
        ({"probability": "0.9"}, "verdict.probability: '0.9' is not of type float"),
        ({"damping": None}, "verdict.damping: null"),
        ({"rate": {"value": 0.1}}, "verdict.rate.low: missing or unknown"),
    ],
)
def test_another_type_or_field_is_noticed(envelope: Verdict, change: dict[str, Any], fault: str) -> None:
    """The negative control."""
    assert fault in type_faults(Verdict, {**envelope.to_dict(), **change})


def test_a_verdict_of_another_version_is_refused(envelope: Verdict, tmp_path: Path) -> None:
    path = envelope.save(tmp_path / "verdict.json")
    assert repr(Verdict.load(path)) == repr(envelope)
    path.write_text(path.read_text().replace(f'"schema": {VERDICT_SCHEMA}', '"schema": 1'))
    with pytest.raises(InputError, match=r"verdict\.json: was written by another version"):
        Verdict.load(path)
