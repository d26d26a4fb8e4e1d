"""A record that is no free decay of one oscillator gets a verdict that says what it is, and no damping law."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.ndimage import gaussian_filter1d

import bayesdamp as bd
from bayesdamp.cli import main
from bayesdamp.interface.answer import answer
from bayesdamp.store import Store
from bayesdamp.store.contents import RecordContent
from bayesdamp.types import Signal
from bayesdamp.verdict import thresholds
from bayesdamp.verdict.parts import Grade, MotionKind
from bayesdamp.verdict.types import Verdict
from tests.records.oscillation.test_modes import OMEGA, sum_of
from tests.studies import study_text


def verdict_on(
    *modes: tuple[float, float, float], samples: int | None = None, noise: float = 0.003, **how: Any
) -> Verdict:
    """The verdict, without sampling, on the first samples of a sum of (amplitude, frequency, damping ratio)."""
    t, y = sum_of(*modes, noise=noise)
    return answer(Signal(t[:samples], y[:samples]), sample=False, **how).verdict


def test_beats_are_said_with_their_sizes_and_kept_in_json() -> None:
    verdict = verdict_on((0.3, 1.0, 0.01), (0.1, 1.12, 0.01))
    assert verdict.grade is Grade.NO_FREE_DECAY
    assert verdict.motion is MotionKind.BEATS
    assert not verdict.decided
    assert verdict.modes[0].low < 0.01 < verdict.modes[0].high  # 95 %, seed fixed
    assert verdict.modes[1].frequency == pytest.approx(1.12 * OMEGA / (2 * np.pi), rel=1e-3)
    assert verdict.sentence.startswith("Not the free decay of one oscillator: two oscillations beat")
    again = Verdict.from_dict(verdict.to_dict())
    assert again == verdict or repr(again) == repr(verdict)


def test_a_small_second_mode_is_a_remark_and_no_more() -> None:
    how: dict[str, Any] = {"damping": ["viscous", "coulomb"], "restoring": ["linear"], "noise": 0.001}
    verdict = verdict_on((0.3, 1.0, 0.01), (0.009, 2.7, 0.01), **how)
    assert verdict.grade is not Grade.NO_FREE_DECAY
    assert verdict.damping == "viscous"
    assert any("second oscillation" in r and "1.719 Hz" in r for r in verdict.remarks)


@pytest.mark.parametrize(
    ("second", "kind"), [((0.024, 1.08, 0.01), MotionKind.BEATS), ((0.009, 1.15, 0.0), MotionKind.DRIVEN)]
)
def test_a_close_second_oscillation_counts_if_no_law_fits(
    second: tuple[float, float, float], kind: MotionKind
) -> None:
    """The amplitude of neither record rises. Without the second oscillation it is viscous damping."""
    verdict = verdict_on((0.3, 1.0, 0.01), second, samples=1000, noise=0.001)
    assert verdict.motion is kind
    assert verdict.modes[0].low < 0.01 < verdict.modes[0].high  # 95 %, seed fixed
    assert verdict_on((0.3, 1.0, 0.01), samples=1000, noise=0.001).damping == "viscous"


def test_a_close_second_oscillation_does_not_count_if_a_law_explains_nearly_all(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Control: the test above, with the same record and the usual limit."""
    monkeypatch.setattr(thresholds, "REMARK", 1.0)
    verdict = verdict_on((0.3, 1.0, 0.01), (0.024, 1.08, 0.01), samples=1000, noise=0.001)
    assert verdict.law_free is not None
    assert verdict.motion is None


def test_compare_tells_it_in_python(tmp_path: Path) -> None:
    t, y = sum_of((0.02, 1.0, -0.012))
    found = bd.compare(Signal(t, y))
    assert found.verdict.motion is MotionKind.GROWING
    assert found.table.empty
    assert "grows" in str(found.verdict)
    with pytest.raises(bd.InputError, match="nothing to draw"):
        found.plot()
    assert "grows" in found.report(tmp_path / "page.html").read_text(encoding="utf-8")


def test_where_no_decay_is_seen_the_loss_is_bounded() -> None:
    """The limit is that of the rate, whose standard error in white noise is sqrt(24) sd / (A T^1.5 rate^.5)."""
    verdict = verdict_on((0.3, 1.0, 0.0))
    assert verdict.motion is MotionKind.STEADY
    assert verdict.damping_ratio == ()
    one = verdict.modes[0]
    expected = 24**0.5 * 0.003 / (0.3 * 40**1.5 * 50**0.5) / OMEGA
    assert (one.high - one.low) / 3.92 == pytest.approx(expected, rel=0.1)
    assert verdict.sentence.startswith("No decay is detected: it oscillates at 0.6366")
    assert "damping ratio is below" in verdict.sentence


def test_a_second_mode_near_a_harmonic_is_named() -> None:
    """It decays like a nonlinear oscillator's harmonic, and bends every law that is fitted to the record."""
    multiple, share = 3.0, 0.1
    modes = (0.3, 1.0, 0.015), (0.3 * share, multiple, 0.015)
    verdict = verdict_on(*modes, noise=0.0003, restoring=["linear", "duffing"])
    assert verdict.motion is MotionKind.TWO_MODES
    assert verdict.modes[0].low < 0.015 < verdict.modes[0].high
    assert verdict.modes[1].frequency == pytest.approx(multiple * OMEGA / (2 * np.pi), rel=0.02)


def test_the_harmonic_of_one_oscillator_is_no_second_mode() -> None:
    """A hardening spring, by an independent solver: its third harmonic has 1 to 2 % of the amplitude."""
    t = np.linspace(0, 40, 4000)
    found = solve_ivp(
        lambda _, s: [s[1], -16 * s[0] - 100 * s[0] ** 3 - 0.12 * s[1]], (0, 40), [0.3, 0.0],
        t_eval=t, rtol=1e-9, atol=1e-11,
    )  # fmt: skip
    y = found.y[0] + 0.0003 * np.random.default_rng(3).standard_normal(t.size)
    verdict = answer(Signal(t, y), restoring=["linear", "duffing"], sample=False).verdict
    assert verdict.decided
    assert verdict.damping == "viscous"
    assert verdict.restoring == "duffing"
    assert not verdict.contradicted


def test_the_frequency_under_a_wandering_base_line_holds() -> None:
    """Of a linear spring: what is read as another spring's law must not move the frequency of small oscillations."""
    t, zeta, omega = np.arange(0, 25, 0.01), 0.01, 2 * np.pi * 1.37
    rng = np.random.default_rng([9, 0])
    wander = gaussian_filter1d(rng.standard_normal(t.size), 150)
    y = np.exp(-zeta * omega * t) * np.cos(omega * np.sqrt(1 - zeta**2) * t)
    y += 0.05 * wander / wander.std() + 0.002 * rng.standard_normal(t.size)
    verdict = answer(Signal(t, y), sample=False).verdict
    for f in filter(None, (verdict.frequency, verdict.frequency_at)):
        assert f.low < 1.37 < f.high


STUDY = study_text(
    'estimators = { use = ["envelope"], stages = ["initial"] }',
    'models = { compare = ["viscous"] }',
    "posterior = { samplers = [] }",
    "evidence = { methods = [] }",
    system='restoring = "linear"',
    file="rig.csv",
    unit="deg",
)


def study_of(folder: Path, rate: float) -> Path:
    """A study that asks for no verdict, on a record that decays at a rate; one line has a cell more."""
    t, y = sum_of((0.1, 1.0, rate))
    rows = [f"{np.degrees(b):.6f}" for b in y]
    lines = [f"{a:.6f},{b}" for a, b in zip(t, rows, strict=True)]
    lines[60] += ",7.5"
    (folder / "rig.csv").write_text("\n".join(["t (s),angle (deg)", *lines]) + "\n")
    (folder / "study.toml").write_text(STUDY)
    return folder / "study.toml"


@pytest.mark.parametrize(("rate", "grows"), [(-0.012, True), (0.012, False)])
def test_a_study_without_a_verdict_says_what_is_wrong_with_a_record(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    rate: float,
    grows: bool,
) -> None:
    monkeypatch.setattr("bayesdamp.report.render.render", lambda out, _: (out / "report.html").write_text(""))
    study, out = str(study_of(tmp_path, rate)), str(tmp_path / "out")
    assert main(["study", study, "--out", out, "--workers", "1", "--quick"]) == 0
    said = capsys.readouterr().out
    assert "Beware: line 62 has 3 cells where the table has 2:" in said
    assert ("rig: Not the free decay of one oscillator: its oscillation at 0.6366" in said) == grows
    assert (" grows from 5.7" in said) == grows, "in degrees"
    content = RecordContent.of(Store(tmp_path / "out").read("signal/rig/0"))
    assert any("grows from 5.7" in text for text in content.anomalies) == grows
