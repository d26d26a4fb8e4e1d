"""A record that is not the free decay of one oscillator gets a verdict that says what it is, and no damping law."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

import bayesdamp as bd
from bayesdamp.cli import main
from bayesdamp.interface.answer import answer, compare_models
from bayesdamp.records.cleaning.clean import clean
from bayesdamp.records.record import RawRecord
from bayesdamp.store.results import RecordContent, Store
from bayesdamp.types import Signal
from bayesdamp.verdict import thresholds
from bayesdamp.verdict.parts import Grade, MotionKind
from bayesdamp.verdict.types import Verdict
from tests.physics.independent import trajectory
from tests.records.oscillation.test_modes import OMEGA, sum_of
from tests.records.tables import write_table
from tests.studies import study_text


def verdict_on(
    *modes: tuple[float, float, float], samples: int | None = None, noise: float = 0.003, **options: Any
) -> Verdict:
    """Return the verdict, without sampling, on the first samples of a sum of (amplitude, frequency, damping ratio)."""
    t, y = sum_of(*modes, noise=noise)
    signal = Signal(t[:samples], y[:samples])
    return answer(signal, compare_models(signal, **options), sample=False).verdict


def test_beats_are_described_by_two_oscillations() -> None:
    parts = (0.3, 1.0, 0.01), (0.1, 1.12, 0.01)
    assert clean(RawRecord(*sum_of(*parts)), name="a").t[-1] > 39  # it is not cut at the first beat
    verdict = verdict_on(*parts)
    assert verdict.grade is Grade.NO_FREE_DECAY
    assert verdict.motion is MotionKind.BEATS
    assert not verdict.decided
    assert verdict.modes[0].low < 0.01 < verdict.modes[0].high  # 95 %, seed fixed
    third = verdict_on(*parts, (0.03, 1.5, 0.01))
    unexplained = [any("do not explain the record" in r for r in v.remarks) for v in (verdict, third)]
    assert unexplained == [False, True]
    t, y = sum_of(*parts, noise=0.003)
    faster = answer(Signal(t / 5, y), compare_models(Signal(t / 5, y)), sample=False).verdict
    assert [m.high for m in faster.modes] == pytest.approx([m.high for m in verdict.modes], rel=1e-3)
    assert verdict.modes[1].frequency == pytest.approx(1.12 * OMEGA / (2 * np.pi), rel=1e-3)
    assert verdict.sentence.startswith("Not the free decay of one oscillator: two oscillations beat")
    assert verdict.modes[1].first / verdict.modes[0].first == pytest.approx(1 / 3, rel=0.05)
    assert repr(Verdict.from_dict(verdict.to_dict())) == repr(verdict)


def test_a_small_second_mode_is_only_a_remark() -> None:
    models = {"damping": ["viscous", "coulomb"], "restoring": ["linear"]}
    verdict = verdict_on((0.3, 1.0, 0.01), (0.009, 2.7, 0.01), noise=0.001, **models)
    assert verdict.grade is not Grade.NO_FREE_DECAY
    assert verdict.damping == "viscous"
    assert any("second oscillation" in r and "1.719 Hz" in r for r in verdict.remarks)


BEATING = (0.024, 1.08, 0.01)


def test_two_equal_close_oscillations_are_a_remark() -> None:
    """Control: a single oscillation of the same size."""
    found = "at 0.6366 and 0.6449 Hz, would explain the record far better than the laws; it may contain both."
    for second, remarks in ([(0.3, 1.013, 0.01)], [f"Two oscillations, {found}"]), ([], []):
        verdict = verdict_on((0.3, 1.0, 0.01), *second, noise=0.0003, restoring=["linear"])
        assert [r for r in verdict.remarks if "Two oscillations" in r] == remarks
        assert verdict.decided is not bool(remarks)


def test_a_close_second_oscillation_counts_if_no_law_fits(monkeypatch: pytest.MonkeyPatch) -> None:
    """The amplitude of no record rises, and the last has less than one beat. Controls: without the second oscillation
    the damping is viscous, and a law that explains nearly everything is not replaced by two oscillations."""
    decay, options = (0.3, 1.0, 0.01), {"samples": 1000, "noise": 0.001}
    doublet = (0.09, 1.013, 0.01)  # 0.65 line widths apart
    for second, samples, kind in (
        (BEATING, 1000, MotionKind.BEATS),
        ((0.009, 1.15, 0.0), 1000, MotionKind.DRIVEN),
        (doublet, 2000, MotionKind.BEATS),
    ):
        verdict = verdict_on(decay, second, samples=samples, noise=0.001)
        assert verdict.motion is kind
        assert verdict.modes[0].low < 0.01 < verdict.modes[0].high  # 95 %, seed fixed
    assert verdict_on(decay, **options).damping == "viscous"
    monkeypatch.setattr(thresholds, "REMARK", 1.0)
    monkeypatch.setattr("bayesdamp.interface.answer.NATS_AHEAD", np.inf)
    verdict = verdict_on(decay, BEATING, **options)
    assert verdict.law_free is not None
    assert verdict.motion is None


@pytest.mark.parametrize("wrong", [1.0, 1.02])
def test_a_wrong_stiffness_is_not_a_second_oscillation(wrong: float) -> None:
    options = {"theta0": 0.4, "duration": 30.0, "samples": 3000, "noise_sd": 1e-3, "seed": 3}
    signal = bd.simulate({"viscous": 0.02, "coulomb": 0.03}, "pendulum", stiffness=20.0, **options)
    verdict = bd.compare(signal, sample=False, known={"stiffness": 20.0 * wrong}).verdict
    assert verdict.motion is None
    assert (wrong > 1) == verdict.remarks[0].startswith("No law fits with the specified stiffness")


def test_compare_describes_a_growing_oscillation(tmp_path: Path) -> None:
    result = bd.compare(Signal(*sum_of((0.02, 1.0, -0.012))))
    assert result.verdict.motion is MotionKind.GROWING
    assert result.table.empty
    assert "grows" in str(result.verdict)
    with pytest.raises(bd.InputError, match="nothing to draw"):
        result.plot()
    assert "grows" in result.report(tmp_path / "page.html").read_text(encoding="utf-8")


def test_the_damping_ratio_of_a_steady_oscillation_has_an_upper_limit() -> None:
    """The standard error of a decay rate in white noise is sqrt(24) sd / (A T^1.5 rate^.5)."""
    verdict = verdict_on((0.3, 1.0, 0.0))
    assert verdict.motion is MotionKind.STEADY
    assert verdict.damping_ratio == ()
    mode = verdict.modes[0]
    expected = 24**0.5 * 0.003 / (0.3 * 40**1.5 * 50**0.5) / OMEGA
    assert (mode.high - mode.low) / 3.92 == pytest.approx(expected, rel=0.1)
    assert verdict.sentence.startswith("No decay is detected: it oscillates at 0.6366")
    assert "damping ratio is below" in verdict.sentence


def test_a_second_mode_near_a_harmonic_is_named() -> None:
    """It decays like a nonlinear oscillator's harmonic, and distorts every law that is fitted to the record."""
    modes = (0.3, 1.0, 0.015), (0.03, 3.0, 0.015)
    verdict = verdict_on(*modes, noise=0.0003, restoring=["linear", "duffing"])
    assert verdict.motion is MotionKind.TWO_MODES
    assert verdict.modes[0].low < 0.015 < verdict.modes[0].high
    assert verdict.modes[1].frequency == pytest.approx(3 * OMEGA / (2 * np.pi), rel=0.02)


def test_the_harmonic_of_one_oscillator_is_not_a_second_mode() -> None:
    """A hardening spring; its third harmonic has 1 to 2 % of the amplitude."""
    t = np.linspace(0, 40, 4000)
    p = {"zeta": 0.06, "stiffness": 16.0, "cubic": 100.0, "rest_angle": 0.0, "theta0": 0.3, "omega0": 0.0}
    y = trajectory("duffing", p, t)[:, 0]
    y += 0.0003 * np.random.default_rng(3).standard_normal(t.size)
    signal = Signal(t, y)
    verdict = answer(signal, compare_models(signal, restoring=["linear", "duffing"]), sample=False).verdict
    assert verdict.decided
    assert verdict.damping == "viscous"
    assert verdict.restoring == "duffing"
    assert not verdict.contradicted


def test_a_wandering_base_line_does_not_change_the_frequency() -> None:
    """The spring is linear; the base line may look like another law, which would change the frequency."""
    t, zeta, omega = np.arange(0, 25, 0.01), 0.01, 2 * np.pi * 1.37
    rng = np.random.default_rng([9, 0])
    wander = gaussian_filter1d(rng.standard_normal(t.size), 150)
    y = np.exp(-zeta * omega * t) * np.cos(omega * np.sqrt(1 - zeta**2) * t)
    y += 0.05 * wander / wander.std() + 0.002 * rng.standard_normal(t.size)
    signal = Signal(t, y)
    verdict = answer(signal, compare_models(signal), sample=False).verdict
    for frequency in filter(None, (verdict.frequency, verdict.frequency_at)):
        assert frequency.low < 1.37 < frequency.high


STUDY = study_text(
    'estimators = { use = ["envelope"], stages = ["initial"] }',
    'models = { compare = ["viscous"] }',
    "posterior = { samplers = [] }",
    "evidence = { methods = [] }",
    system='restoring = "linear"',
    file="rig.csv",
    unit="deg",
)


def test_a_study_without_a_verdict_says_what_is_wrong_with_a_record(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """One record grows, the other decays; one line of each has a cell too many. Amplitudes are in degrees."""
    monkeypatch.setattr(
        "bayesdamp.report.sections.render", lambda out, _: (out / "report.html").write_text("")
    )
    (tmp_path / "study.toml").write_text(STUDY)
    for rate in (-0.012, 0.012):
        t, y = sum_of((0.1, 1.0, rate))
        path = write_table(tmp_path / "rig.csv", "t (s),angle (deg)", t, np.degrees(y))
        lines = path.read_text().splitlines()
        lines[61] += ",7.5"
        path.write_text("\n".join(lines))
        out = tmp_path / f"out{rate}"
        words = ["--out", str(out), "--workers", "1", "--quick"]
        assert main(["study", str(tmp_path / "study.toml"), *words]) == 0
        printed = capsys.readouterr().out
        assert "Beware: line 62 has 3 cells where the table has 2:" in printed
        assert ("Not the free decay of one oscillator: its oscillation at 0.6366" in printed) == (rate < 0)
        assert (" grows from 5.7" in printed) == (rate < 0)
        anomalies = RecordContent.of(Store(out).read("signal/rig/0")).anomalies
        assert ("grows from 5.7" in " ".join(anomalies)) == (rate < 0)
