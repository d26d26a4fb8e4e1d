"""A record that is no free decay of one oscillator gets a verdict that says what it is, and no damping law."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import bayesdamp as bd
from bayesdamp.pipeline.answer import answer
from bayesdamp.types import Signal
from bayesdamp.verdict.parts import Grade, Motion
from bayesdamp.verdict.types import Verdict
from tests.records.oscillation.test_one import OMEGA, shaken, sum_of


def test_beats_are_said_with_their_sizes_and_kept_in_json() -> None:
    t, y = sum_of((0.3, 1.0, 0.01), (0.1, 1.12, 0.01))
    verdict = answer(Signal(t, y)).verdict
    assert verdict.grade is Grade.NO_FREE_DECAY
    assert verdict.motion is Motion.BEATS
    assert not verdict.decided
    assert verdict.modes[0].low < 0.01 < verdict.modes[0].high  # 95 %, seed fixed
    assert verdict.modes[1].frequency == pytest.approx(1.12 * OMEGA / (2 * np.pi), rel=1e-3)
    assert verdict.sentence.startswith("Not the free decay of one oscillator: two oscillations beat")
    again = Verdict.from_dict(verdict.to_dict())
    assert again == verdict or repr(again) == repr(verdict)


def test_velocities_give_amplitudes_of_the_displacement() -> None:
    t, x = sum_of((0.3, 1.0, 0.01), (0.1, 2.7, 0.01), noise=0.0)
    v = np.gradient(x, t) + 0.01 * np.random.default_rng(2).standard_normal(t.size)
    modes = answer(Signal(t, v, "velocity")).verdict.modes
    assert sorted(m.first for m in modes) == pytest.approx([0.1, 0.3], rel=0.05)


def test_a_small_second_mode_is_a_remark_and_no_more() -> None:
    t, y = sum_of((0.3, 1.0, 0.01), (0.009, 2.7, 0.01), noise=0.001)
    verdict = answer(Signal(t, y), damping=["viscous", "coulomb"], restoring=["linear"], sample=False).verdict
    assert verdict.grade is not Grade.NO_FREE_DECAY
    assert verdict.damping == "viscous"
    assert any("second oscillation" in r and "1.719 Hz" in r for r in verdict.remarks)


def test_compare_tells_it_in_python(tmp_path: Path) -> None:
    t, y = sum_of((0.02, 1.0, -0.012))
    found = bd.compare(Signal(t, y))
    assert found.verdict.motion is Motion.GROWING
    assert found.table.empty
    assert "grows" in str(found.verdict)
    with pytest.raises(bd.InputError, match="nothing to draw"):
        found.plot()
    assert "grows" in found.report(tmp_path / "page.html").read_text(encoding="utf-8")


def test_where_no_decay_is_seen_the_loss_is_bounded() -> None:
    """The limit is that of the rate, whose standard error in white noise is sqrt(24) sd / (A T^1.5 rate^.5)."""
    t, y = sum_of((0.3, 1.0, 0.0))
    verdict = answer(Signal(t, y)).verdict
    assert verdict.motion is Motion.STEADY
    assert verdict.damping_ratio == ()
    one = verdict.modes[0]
    expected = 24**0.5 * 0.003 / (0.3 * 40**1.5 * 50**0.5) / OMEGA
    assert (one.high - one.low) / 3.92 == pytest.approx(expected, rel=0.1)
    assert verdict.sentence.startswith("No decay is seen: it oscillates at 0.6366")
    assert "damping ratio is below" in verdict.sentence


def test_ambient_vibration_is_told_from_a_decay() -> None:
    t, y = shaken(0.01, 200, 8)
    verdict = answer(Signal(t, y)).verdict
    assert verdict.motion is Motion.EXCITED
    assert verdict.sentence.startswith("Not the free decay of one oscillator: at 1")
    again = Verdict.from_dict(verdict.to_dict())
    assert repr(again) == repr(verdict)
    assert verdict.remarks == ()
