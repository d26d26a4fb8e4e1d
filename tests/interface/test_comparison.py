"""`compare` in Python: one record, several records of one specimen, units, and the report."""

import re
from collections.abc import Sequence
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp

import bayesdamp as bd
from bayesdamp.inference.deviation import model_comparison
from bayesdamp.inference.deviation.model_comparison import FAR_BEHIND
from bayesdamp.physics.damping import TERMS
from tests.interface.problems import TIMES, TRUTH, not_refused, record
from tests.physics.independent import trajectory
from validation.truth.records import case

mpl.use("Agg")
CASE = case("family", 33, 0)
LAW = [CASE.restoring]


@lru_cache
def compared() -> bd.Comparison:
    return bd.compare(CASE.signal, restoring=LAW)


def quick(
    signal: bd.Signal | list[bd.Signal], *damping: str, restoring: Sequence[str] = LAW, **options: Any
) -> bd.Comparison:
    """Compare dampings without sampling; by default viscous damping alone."""
    return bd.compare(signal, damping=damping or ("viscous",), restoring=restoring, sample=False, **options)


def test_a_comparison_names_the_damping(tmp_path: Path) -> None:
    result = compared()
    assert result.outcome == "ok"
    assert result.verdict.damping == "viscous"
    assert {"damping", "log_evidence", "outcome"} <= set(result.table.columns)
    assert result.table.groupby("record")["log_evidence"].max().eq(0).all()
    assert (result.curve["ratio_low"] <= result.curve["ratio_high"]).all()
    assert (result.curve["lost_low"] <= result.curve["lost_high"]).all()
    assert result.verdict.sentence in repr(result)
    page = result.report(tmp_path / "rig.html").read_text(encoding="utf-8")
    assert result.verdict.sentence.split(":")[0] in page
    assert bd.load(result.save(tmp_path / "rig.bd")).verdict == result.verdict
    axes = plt.subplots(2, 2)[1]
    assert result.plot(ax=axes) == tuple(axes.ravel())
    plt.close("all")


class Unsolved(bd.DampingTerm):
    """A damping term without a kernel, so that its equation of motion cannot be compiled."""

    name, parameter, unit = "unsolved", "c_unsolved", "1/s"


def test_only_models_with_a_term_without_a_kernel_are_left_out() -> None:
    TERMS.add("unsolved", Unsolved())
    try:
        result = quick(CASE.signal, "viscous", "viscous+unsolved")
        alone = quick(CASE.signal, "unsolved")
    finally:
        TERMS.remove("unsolved")
    assert result.verdict.damping == "viscous"
    (remark,) = [r for r in result.verdict.remarks if r.startswith("viscous+unsolved was not compared: ")]
    assert "has no `kernel`" in remark
    assert "has no `kernel`" in alone.outcome


def test_without_any_fit_the_outcome_is_the_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(model_comparison.ModelComparison, "evaluate", lambda *_: None)
    result = quick(CASE.signal)
    assert result.outcome.endswith("; choose a part of the record, or compare other damping models.")
    assert not result.verdict.decided


def test_a_model_far_behind_is_in_the_table_without_a_remark(tmp_path: Path) -> None:
    t = np.arange(2000) / 50.0
    y = np.exp(-0.05 * t) * np.cos(4.0 * t) + 1e-3 * np.random.default_rng(3).standard_normal(t.size)
    result = quick(bd.signal(t, y), "viscous", "quadratic", restoring=["linear"])
    assert result.verdict.damping == "viscous"
    assert result.table.set_index("damping")["outcome"]["quadratic"] == FAR_BEHIND
    page = result.report(tmp_path / "page.html").read_text(encoding="utf-8")
    assert f"Not fitted ({FAR_BEHIND}): quadratic (linear)" in page
    assert not any("not weighed" in remark for remark in result.verdict.remarks)
    dampings = "quadratic", "viscous+quadratic", "viscous"
    exact = quick(bd.signal(t, y), *dampings, restoring=["linear"], deviation="none").table
    assert list(exact["damping"]) == ["viscous", "viscous+quadratic", "quadratic"]


def test_a_remark_says_where_cycles_cannot_be_counted() -> None:
    """The sign of the oscillation changes during a gap. Control: the same gap without a change needs no remark."""
    t = 5.0 + np.arange(5040) / 12.0
    rng = np.random.default_rng(4)
    y = np.exp(-(t - 5) / 200) * np.cos(2 * np.pi * (t - 5)) + 1e-3 * rng.standard_normal(t.size)
    recorded = (t < 215) | (t > 221)
    for sign, count in ((1.0, 0), (-1.0, 1)):
        signal = bd.signal(t[recorded], np.where(t > 215, sign, 1.0)[recorded] * y[recorded])
        result = quick(signal, restoring=["linear"])
        remarks = [r for r in result.verdict.remarks if r.startswith("The cycles in the gap at ")]
        assert len(remarks) == count
        if count:
            at = float(remarks[0].removeprefix("The cycles in the gap at ").split(" s ")[0])
            assert 215 < at < 221


def test_the_ratio_of_a_power_law_is_right_at_small_amplitudes() -> None:
    """SciPy's solution of a spring with the force 0.9 |v|^0.4, whose ratio under a sinusoid follows by quadrature."""
    t, w, p = np.linspace(0, 14, 700), 2 * np.pi, 0.4

    def slope(_: float, s: np.ndarray) -> list[float]:
        return [s[1], -(w**2) * s[0] - 0.9 * np.sign(s[1]) * abs(s[1]) ** p]

    x = solve_ivp(slope, (0, 14), [0.5, 0.0], t_eval=t, rtol=1e-9, atol=1e-11, max_step=0.01).y[0]
    signal = bd.signal(t, x + 1e-3 * np.random.default_rng(2).standard_normal(t.size), unit="m")
    verdict = bd.compare(signal, sample=False).verdict
    assert verdict.rivals[0].damping == "power"
    turn, _ = quad(lambda a: abs(np.sin(a)) ** (p + 1), 0, 2 * np.pi)
    for r in verdict.damping_ratio:
        truth = 0.9 * (w * r.amplitude) ** p * r.amplitude * turn / (2 * np.pi * (w * r.amplitude) ** 2)
        assert r.low < truth < r.high  # 95 %, seed fixed
        assert r.value == pytest.approx(truth, rel=0.03)


def test_a_double_well_may_have_a_known_negative_stiffness() -> None:
    """θ̈ = 5θ − 20θ³ − 0.1 θ̇ about its rest position 0.5, where ω² = −5 + 60 · 0.25: the ratio is 0.05/ω for small
    amplitudes. The cubic parameter is unknown, so that the known values alone do not have a rest position."""
    t = np.linspace(0.0, 25.0, 1000)
    known, priors = {"stiffness": -5.0, "rest_angle": 0.0}, {"cubic": bd.LogNormal(20.0, 0.3)}
    y = trajectory("duffing", {**known, "cubic": 20.0, "zeta": 0.05, "theta0": 0.55, "omega0": 0.0}, t)[:, 0]
    y += 1e-4 * np.random.default_rng(1).standard_normal(t.size)
    signal = bd.signal(t, y, cleaned=False)
    last = quick(signal, restoring=["duffing"], known=known, priors=priors).verdict.damping_ratio[-1]
    assert last.low < 0.05 / 10**0.5 < last.high


def test_records_of_one_specimen_share_a_damping(tmp_path: Path) -> None:
    """The ratios are given at the requested amplitudes, in the unit of the files; their truth is ζ/√k."""
    signals = [bd.signal(TIMES, np.degrees(record(seed).y), unit="deg", cleaned=False) for seed in (3, 4)]
    models = {"damping": ["viscous", "coulomb"], "restoring": ["linear"]}
    both = bd.compare(signals, repeats=True, name="rig", amplitudes=[13.0, 11.0], **models)
    assert both.verdict.damping == "viscous"
    assert [r.amplitude for r in both.verdict.damping_ratio] == pytest.approx([13.0, 11.0])
    assert all(r.low < TRUTH["zeta"] / TRUTH["stiffness"] ** 0.5 < r.high for r in both.verdict.damping_ratio)
    assert both.verdict.record == "rig"
    assert len(both.records) == 2
    text = re.sub("<[^>]+>", "", both.report(tmp_path / "rig.html").read_text(encoding="utf-8"))
    assert both.verdict.sentence in text
    assert "The damping differs between records by" in text


REFUSED: list[tuple[dict, str]] = [
    ({"damping": ["viscuos"]}, "viscous"),
    ({"known": {"stifness": 20.0}}, "did you mean 'stiffness'"),
    ({"known": {"cubic": 1.0}, "restoring": "linear"}, r"known\.cubic: unknown key"),
    ({"known": {"stiffness": -4.0}, "restoring": "pendulum"}, "-4: it must be above 0 under the law"),
    ({"priors": {"visc": bd.HalfNormal(0.1)}}, "did you mean 'viscous'"),
    ({"sensor": -1.0}, "0 to below"),
]


def test_a_wrong_argument_is_refused_in_one_line() -> None:
    twice = partial(bd.compare, [CASE.signal] * 2)
    several = [(twice, "repeats"), (partial(twice, repeats=True), "same record")]
    single = ((partial(bd.compare, CASE.signal, **options), pattern) for options, pattern in REFUSED)
    assert not_refused([*several, *single]) == []


def test_a_prior_may_be_given_by_the_term_or_by_its_parameter() -> None:
    """Control: another prior gives another coefficient."""
    narrow, other = bd.LogNormal(0.02, 0.01), bd.LogNormal(0.03, 0.01)
    by_term, by_name, control = (
        quick(CASE.signal, priors=p).verdict.coefficients[0].value
        for p in ({"viscous": narrow}, {"zeta": narrow}, {"viscous": other})
    )
    assert by_term == by_name
    assert by_term != pytest.approx(control, rel=0.01)


@lru_cache
def in_degrees() -> tuple[bd.Signal, bd.Signal]:
    """Return one record with values in rad, and with the same values in degrees."""
    t, y = CASE.signal.t, CASE.signal.y
    deg = bd.signal(t, np.degrees(y), unit="deg", name="deg", cleaned=False)
    return bd.signal(t, y, name="rad", cleaned=False), deg


def test_a_record_in_degrees_is_answered_in_degrees(tmp_path: Path) -> None:
    """The expected numbers are those of the same record in rad, times 180/π to the power of their unit."""
    rad, deg = map(quick, in_degrees())
    for a, b in zip(rad.verdict.damping_ratio, deg.verdict.damping_ratio, strict=True):
        assert (a.unit, b.unit) == ("rad", "deg")
        assert b.amplitude == pytest.approx(np.degrees(a.amplitude), rel=1e-6)
        assert b.value == pytest.approx(a.value, rel=1e-6)
    assert " rad" not in deg.verdict.sentence
    assert all(" deg" in text for text in (deg.verdict.sentence, repr(deg), deg._repr_html_()))
    turn = 180 / np.pi
    for name, power in {"amplitude": 1, "ratio": 0, "lost": 2, "lost_high": 2}.items():
        assert deg.curve[name].to_numpy() == pytest.approx(rad.curve[name].to_numpy() * turn**power, rel=1e-5)
    assert deg.table["rms"].min() == pytest.approx(turn * rad.table["rms"].min(), rel=1e-5)
    assert deg.summary()["unit_1"].item() == "deg"
    for axes in deg.plot():
        assert "rad" not in axes.get_ylabel() + axes.get_xlabel()
    page = deg.report(tmp_path / "deg.html").read_text(encoding="utf-8")
    assert " deg" in page
    assert f"{rad.verdict.damping_ratio[0].amplitude:.3g} rad" not in page
    # An accelerometer's values in g are drawn in the base unit of its displacement.
    y = 0.02 * np.exp(-0.05 * TIMES) * np.cos(4.5 * TIMES)
    in_g = bd.signal(TIMES, y, quantity="acceleration", unit="g", cleaned=False)
    labels = [ax.get_ylabel() for ax in quick(in_g, restoring=["linear"]).plot()]
    assert labels[::2] == ["acceleration / (m/s²)"] * 2
    assert labels[1::2] == ["damping ratio / %", "energy lost / (m²/s²)"]
    plt.close("all")


def test_amplitudes_are_in_the_records_own_unit() -> None:
    _, signal = in_degrees()
    amplitude = quick(signal).verdict.damping_ratio[1].amplitude
    ratios = quick(signal, amplitudes=[amplitude]).verdict.damping_ratio
    assert [r.amplitude for r in ratios] == pytest.approx([amplitude])
    with pytest.raises(bd.InputError, match=r"0\.001 deg: the amplitudes of the record are .* deg"):
        quick(signal, amplitudes=[0.001])


def test_a_fit_of_a_record_in_degrees_uses_degrees() -> None:
    _, signal = in_degrees()
    rad, deg = (bd.fit(s, bd.Model("viscous", *LAW, deviation="law")) for s in in_degrees())
    a, b = rad.damping_ratio(), deg.damping_ratio()
    assert set(b["unit"]) == {"deg"}
    assert b["amplitude"].to_numpy() == pytest.approx(np.degrees(a["amplitude"].to_numpy()), rel=1e-6)
    row = deg.damping_ratio([float(b["amplitude"][1])]).iloc[0]
    assert row["amplitude"] == pytest.approx(b["amplitude"][1])
    assert row["value"] == pytest.approx(b["value"][1], rel=0.02)
    for axes in (*deg.plot(), signal.plot()):
        assert "rad" not in axes.get_ylabel()
    assert f"residual {np.degrees(np.sqrt(np.mean(deg.residuals**2))):.3g} deg rms" in repr(deg)
    assert " deg" in repr(signal)


def test_a_record_of_two_cycles_has_no_curve_without_a_law_and_the_report_says_so(tmp_path: Path) -> None:
    t = np.linspace(0.0, 2.0, 16)
    signal = bd.signal(t, 0.3 * np.exp(-0.05 * t) * np.cos(6.0 * t), cleaned=False)
    result = quick(signal, restoring=["linear"])
    assert result.curve.empty
    assert not result.law_curve.empty
    assert "There is no brown band: " in result.report(tmp_path / "page.html").read_text(encoding="utf-8")
    assert len(result.plot()) == 4
    plt.close("all")


def test_a_law_that_contradicts_the_record_is_not_in_the_report(tmp_path: Path) -> None:
    """The frequency drops by 2.5 % and the rate of decay rises by a half at 10 s: no law of the amplitude does both."""
    t = np.arange(0, 30, 0.01)
    rate, hertz = np.where(t < 10, 0.1, 0.15), np.where(t < 10, 2.0, 1.95)
    y = 0.3 * np.exp(-np.cumsum(rate) * 0.01) * np.cos(2 * np.pi * np.cumsum(hertz) * 0.01)
    y += 0.001 * np.random.default_rng(0).standard_normal(t.size)
    signal = bd.signal(t, y, cleaned=False, name="drops")
    result = bd.compare(signal, damping=["viscous"], restoring=["linear"])
    assert result.verdict.contradicted
    late = result.curve[result.curve["amplitude"].between(0.02, 0.08)]
    omega = 2 * np.pi * 1.95
    true = 0.15 / omega
    assert (late["ratio_low"] < true).all()
    assert (true < late["ratio_high"]).all()
    squares = (omega * late["amplitude"]) ** 2
    assert late["lost"].to_numpy() == pytest.approx(2 * np.pi * true * squares, rel=0.1)
    assert result.law_curve.empty
    text = re.sub("<[^>]+>", " ", result.report(tmp_path / "page.html").read_text(encoding="utf-8"))
    assert "contradicts this, so none is named" in text
    control = compared().report(tmp_path / "control.html").read_text(encoding="utf-8")
    for words, stated in (("Coefficients of", False), ("Energy lost: ", False), ("is not drawn", True)):
        assert (words in text, words in control) == (stated, not stated), words
    assert not result.plot()[2].axison


@pytest.mark.parametrize("samples", [250, 4000])
def test_the_noise_is_that_of_single_samples(samples: int) -> None:
    """Of 4000 samples the answer uses means, whose noise is half as large. The estimate from 250 values is within 15 %
    of the truth with a probability of 0.999."""
    sd, amplitude = 0.004, 0.3
    truth = {"stiffness": 20.0, "theta0": amplitude, "duration": 16.0, "samples": samples}
    result = quick(bd.simulate({"viscous": 0.08}, noise_sd=sd, seed=3, **truth), restoring=["linear"])
    assert result.verdict.noise_pct == pytest.approx(100 * sd / amplitude, rel=0.15)
    assert result.table["rms"].min() == pytest.approx(sd, rel=0.15)


def test_amplitudes_for_records_in_different_units_are_in_the_first_unit() -> None:
    """Control: the same records, all in degrees. Rounding errors of the conversion change draws by some 1e-5."""
    values = [record(seed).y for seed in (3, 4)]
    deg = [bd.signal(TIMES, np.degrees(y), unit="deg", cleaned=False) for y in values]
    rad = bd.signal(TIMES, values[1], cleaned=False)
    options: dict[str, Any] = {"repeats": True, "amplitudes": [13.0, 11.0], "restoring": ["linear"]}
    mixed, control = (
        [[r.value for r in v.damping_ratio] for v in (result.verdict, *(x.verdict for x in result.records))]
        for result in (quick([deg[0], rad], **options), quick(deg, **options))
    )
    assert np.array(mixed) == pytest.approx(np.array(control), rel=1e-3)
    metres = bd.signal(TIMES, values[1], unit="m", cleaned=False)
    with pytest.raises(bd.InputError, match="amplitudes: the records are in rad and m; leave out amplitudes"):
        quick([deg[0], metres], **options)
