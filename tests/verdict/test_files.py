"""verdict.json and verdicts.csv have the same fields for a record of the motion and for one of its envelope."""

from __future__ import annotations

import csv
import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bayesdamp.interface.envelopes import analyse
from bayesdamp.records.envelope.record import make_record
from bayesdamp.verdict.types import columns, load_verdicts, save_verdicts
from tests.verdict.test_decide import HERTZ, verdict_of


def test_an_envelope_and_a_motion_have_the_same_fields(tmp_path: Path) -> None:
    t = 12.0 * np.arange(10.0)
    y = 3.0 * 0.5 ** (t / 12.0) * np.exp(0.02 * np.random.default_rng(2).standard_normal(t.size))
    envelope = analyse(make_record("swing.csv", t, y, "mm", 2.0)).verdict
    motion = replace(verdict_of(frequency_at=HERTZ), unexplained_pct=math.nan)
    save_verdicts(tmp_path, [motion, envelope])
    content = json.loads((tmp_path / "verdict.json").read_text(), parse_constant=pytest.fail)
    assert [v["schema"] for v in content] == [1, 1]
    assert content[0].keys() == content[1].keys()
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
