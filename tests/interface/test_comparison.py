"""`compare` in Python: one record, several of one specimen, saved, loaded, drawn and written as a page."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import matplotlib as mpl
import pytest

import bayesdamp as bd
from bayesdamp.validation.truth.records import case

mpl.use("Agg")


@lru_cache
def compared() -> bd.Comparison:
    made = case("family", 33, 0)
    return bd.compare(made.signal, restoring=[made.restoring])


def test_a_comparison_names_the_damping(tmp_path: Path) -> None:
    result = compared()
    assert result.outcome == "ok"
    assert result.verdict.damping == "viscous"
    assert {"damping", "log_evidence", "outcome"} <= set(result.table.columns)
    assert result.table.groupby("record")["log_evidence"].max().eq(0).all()
    assert (result.curve["ratio_low"] <= result.curve["ratio_high"]).all()
    assert (result.curve["lost_low"] <= result.curve["lost_high"]).all()
    assert list(result.law_curve.columns) == ["amplitude", "ratio", "ratio_low", "ratio_high", "record"]
    assert result.verdict.sentence in repr(result)
    page = result.report(tmp_path / "rig.html").read_text(encoding="utf-8")
    assert result.verdict.sentence.split(":")[0] in page
    again = bd.load(result.save(tmp_path / "rig.bd"))
    assert again.verdict == result.verdict
    assert len(result.plot().axes) == 4


def test_records_of_one_specimen_share_a_damping() -> None:
    made = case("family", 33, 0)
    other = case("family", 33, 0)
    both = bd.compare([made.signal, other.signal], repeats=True, restoring=[made.restoring], name="rig")
    assert both.verdict.damping == "viscous"
    assert both.verdict.record == "rig"
    assert len(both.records) == 2


@pytest.mark.parametrize(
    ("how", "said"),
    [
        ({"damping": ["viscuos"]}, "viscous"),
        ({"restoring": ["lineal"]}, "linear"),
        ({"deviation": "no"}, "auto"),
    ],
)
def test_a_wrong_name_is_one_line(how: dict, said: str) -> None:
    with pytest.raises(bd.InputError, match=said):
        bd.compare(case("family", 33, 0).signal, **how)


def test_several_records_need_repeats() -> None:
    made = case("family", 33, 0).signal
    with pytest.raises(bd.InputError, match="repeats"):
        bd.compare([made, made])
