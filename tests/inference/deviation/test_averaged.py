"""Records of hundreds of cycles, reduced to amplitudes and phases, against the equation of motion and closed forms."""

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from bayesdamp.inference.deviation.averaged import BLOCKS, MOST_SHIFT
from bayesdamp.inference.deviation.candidate import MotionCandidate
from bayesdamp.inference.deviation.compare import averaging_of, compare_signal
from bayesdamp.inference.deviation.data import prepare_data
from bayesdamp.inference.deviation.findings import compute_findings
from bayesdamp.inference.deviation.model_comparison import ModelComparison, compare_candidates
from bayesdamp.physics.damping import PAPER_TERMS
from bayesdamp.physics.kernel.averaged import NUMBERS
from bayesdamp.physics.kernel.solve import NONE, TOLERANCE
from bayesdamp.types import Signal
from tests.physics.independent import trajectory, viscous

OMEGA, CYCLES = 20.0, 450
TIMES = np.linspace(0.0, CYCLES * 2 * np.pi / OMEGA, CYCLES * 30)
PENDULUM = {
    "stiffness": OMEGA**2, "rest_angle": 0.0, "theta0": 0.8, "omega0": 0.0, "epsilon": 0.06,
    "zeta": 1.0 / TIMES[-1], "mu_q": 0.001857,
}  # fmt: skip


def closed_form(cycles: float) -> Signal:
    """Return a record of a linear oscillator with viscous damping in closed form."""
    t = np.linspace(0.0, cycles * 2 * np.pi / OMEGA, round(12 * cycles))
    y = viscous(t, 1.8 / t[-1], OMEGA, 0.3)
    return Signal(t, y + 0.003 * np.random.default_rng(8).standard_normal(t.size), name="closed")


def without(signal: Signal, a: float, b: float) -> Signal:
    """Return a record without the samples between two shares of its duration."""
    remaining = (signal.t < a * signal.t[-1]) | (signal.t > b * signal.t[-1])
    return Signal(signal.t[remaining], signal.y[remaining], name="with a hole")


@lru_cache
def both() -> tuple[ModelComparison, ModelComparison]:
    """Return the comparisons on a pendulum's record by amplitudes and phases, and by the equation of motion."""
    noise = 0.008 * np.random.default_rng(5).standard_normal(TIMES.size)
    signal = Signal(TIMES, trajectory("pendulum", PENDULUM, TIMES)[:, 0] + noise)
    candidates = [MotionCandidate(c, "pendulum") for c in (("viscous",), ("viscous", "quadratic"))]
    averaged = compare_signal(signal, damping=["viscous", "viscous+quadratic"], restoring=["pendulum"])
    return averaged, compare_candidates(prepare_data(signal, average=False), candidates)


def squares(comparison: ModelComparison) -> np.ndarray:
    """Return the mean squares of the residuals of 64 amplitudes, phases and midlines, in units of the variance of the
    noise. Their sd is 0.18."""
    residual = (comparison.data.averaged.y - comparison.best.motion.y) / comparison.data.averaged.noise
    return np.mean(residual.reshape(-1, NUMBERS) ** 2, axis=0)


def test_the_answer_is_that_of_the_equation_of_motion() -> None:
    """Coefficients, and the damping ratios at three amplitudes, agree within a tenth of their sd. Amplitudes and phases
    determine the midline less well than all samples do: only its value is compared, to 0.3 sd."""
    averaged, full = both()
    assert averaged.averaging.close
    assert full.data.averaged is None
    assert np.all((squares(averaged) > 0.3) & (squares(averaged) < 1.9))
    a, b = compute_findings(averaged), compute_findings(full)
    assert next(iter(a.damping)) == next(iter(b.damping)) == "viscous+quadratic"
    best = [next(r for r in c.results if len(r.candidate.damping) == 2) for c in both()]
    sds = [np.linalg.norm(r.exact_posterior.factors[0], axis=1) for r in best]
    names = best[0].fit.parameters.free_names
    for name, z, z_full, sd, sd_full in zip(names, *(r.fit.z for r in best), *sds, strict=True):
        within = {"theta0": np.inf, "omega0": np.inf, "rest_angle": 0.3}.get(name, 0.1)
        assert abs(z - z_full) < within * sd_full, name
        assert within > 0.1 or sd == pytest.approx(sd_full, rel=0.15), name
    for ratio, full_ratio in zip(a.ratios, b.ratios, strict=True):
        assert abs(ratio.value - full_ratio.value) < 0.1 * np.hypot(full_ratio.sd_noise, full_ratio.sd_law)


def test_the_check_detects_a_motion_that_is_not_corrected() -> None:
    averaged, _ = both()
    removed = {"linearisation": None, "approximate_posterior": None}
    results = tuple(replace(r, solver=replace(r.solver, defect=None), **removed) for r in averaged.results)
    assert not averaging_of(replace(averaged, results=results)).close


def test_records_of_few_cycles_or_with_a_known_start_are_not_averaged() -> None:
    """A short hole, of 2.5 of 500 cycles, does not matter."""
    long = closed_form(500)
    assert prepare_data(closed_form(200)).averaged is None
    assert prepare_data(without(long, 0.5, 0.505)).averaged is not None
    assert viscous_alone(long, theta0=0.3, omega0=0.0).data.averaged is None


def test_blocks_end_at_holes_and_begin_again_after_them(monkeypatch: pytest.MonkeyPatch) -> None:
    """With three holes, damping ratios and evidence are those of the equation of motion at all samples. The noise is
    known, because 64 blocks determine it only to 5 %, and evidence depends on it."""
    signal = closed_form(700)
    for begin, end in ((0.05, 0.1), (0.4, 0.43), (0.9, 0.95)):
        signal = without(signal, begin, end)

    def compare() -> ModelComparison:
        return compare_signal(
            signal, damping=["viscous", "viscous+coulomb"], restoring=["linear"], known={"noise_sd": 0.003},
            approximate=False,
        )  # fmt: skip

    averaged = compare()
    assert averaged.averaging.close
    assert not averaged.data.averaged.wander
    assert not averaged.data.averaged.jumps
    monkeypatch.setattr("bayesdamp.inference.deviation.data.average_of", lambda *_: None)
    full = compare()
    assert full.data.averaged is None
    for ratio, exact in zip(compute_findings(averaged).ratios, compute_findings(full).ratios, strict=True):
        assert abs(ratio.value - exact.value) < 0.1 * (exact.high - exact.low)
        assert ratio.high - ratio.low == pytest.approx(exact.high - exact.low, rel=0.1)
    factors = [np.subtract(*(r.log_evidence for r in c.results)) for c in (averaged, full)]
    assert factors[0] == pytest.approx(factors[1], abs=0.3)


def test_the_weight_of_a_block_is_that_of_its_samples() -> None:
    """60 % of a block between two holes have this weight. 60 % of a block before the first hole are not used."""
    signal = closed_form(1400)
    for begin, end in ((0.6, 2.0), (6.0, 8.0), (8.6, 10.0)):
        signal = without(signal, begin / BLOCKS, end / BLOCKS)
    data = prepare_data(signal)
    weights, middles = data.averaged.track.weights[:, 0], data.averaged.track.middles
    assert middles[0] * BLOCKS / data.duration == pytest.approx(2.5, abs=0.05)
    assert weights[4] == pytest.approx(np.sqrt(0.6), rel=0.1)
    assert np.all(np.abs(np.delete(weights, 4) - 1) < 0.1)


def viscous_alone(signal: Signal, **known: float) -> ModelComparison:
    return compare_signal(signal, damping=["viscous"], restoring=["linear"], known=known, approximate=False)


def frequency_of(comparison: ModelComparison) -> tuple[float, float]:
    """Return the frequency of the best candidate under exact laws, and its sd, in rad/s."""
    fit, factor = comparison.best.fit, comparison.best.exact_posterior.factors[0]
    place = fit.parameters.free_names.index("stiffness")
    sd = np.linalg.norm(factor, axis=1)[place] * fit.parameters.rates(fit.z)[place]
    omega = np.sqrt(fit.parameters.named(fit.z)["stiffness"])
    return float(omega), float(sd / (2 * omega))


def test_a_lost_half_period_in_a_hole_changes_neither_frequency_nor_damping() -> None:
    """Both are the true ones within five sds. The phase may jump at the hole, and the sd of the frequency is twice that
    of the record without the loss, which is the control."""
    whole, sds = closed_form(700), []
    t, y = np.asarray(whole.t), np.asarray(whole.y)
    for sign in (1.0, -1.0):
        slipped = Signal(t, np.where(t > 0.505 * t[-1], sign, 1.0) * y, name="slipped")
        comparison = viscous_alone(without(slipped, 0.5, 0.51))
        assert comparison.data.averaged.jumps == pytest.approx([0.505 * t[-1]] if sign < 0 else [], rel=0.01)
        frequency, sd = frequency_of(comparison)
        sds.append(sd)
        assert abs(frequency - OMEGA) < 5 * sd
        truth = 1.8 / t[-1] / OMEGA
        ratios = compute_findings(comparison).ratios
        assert all(abs(r.value - truth) < 5 / 2 * (r.high - r.low) for r in ratios)
    assert 1.5 < sds[1] / sds[0] < 3


def test_phases_of_thousands_of_cycles_are_accurate() -> None:
    """The phase of 5,000 cycles is that of a solution with a hundredth of the tolerance, within `MOST_SHIFT` sds of the
    noise. Control: with a tolerance that is not scaled for slow variables, it is not."""
    signal = closed_form(5000)
    p = {"stiffness": OMEGA**2, "mu_q": 4.0 / float(signal.t[-1]) / 0.3, "theta0": 0.3}
    data = prepare_data(signal)
    solver = data.solver(PAPER_TERMS, "linear", 0.06, np.linspace(0.0, data.t[-1], 6))
    at, active = np.array([p.get(n, 0.0) for n in solver.names]), np.arange(3) == 2

    def error(tolerance: float) -> float:
        both = tolerance, 1e-2 * TOLERANCE
        y, exact = (solver.solve(at, active, tangents=NONE, tolerance=x).y for x in both)
        return float(np.max(np.abs(y - exact)) / data.averaged.noise)

    assert error(TOLERANCE) < MOST_SHIFT
    assert error(solver.slowness * TOLERANCE) > 2 * MOST_SHIFT


def wandering(rms: float, seed: int) -> Signal:
    """Return a record whose phase is a random walk with this sd at its end, in rad."""
    rng, t = np.random.default_rng(seed), np.arange(50_000) / 50
    phase = OMEGA * t + rms * np.cumsum(rng.standard_normal(t.size)) / np.sqrt(t.size)
    y = 0.3 * np.exp(-3 * t / t[-1]) * np.cos(phase) + 3e-4 * rng.standard_normal(t.size)
    return Signal(t, y, name="wandering")


def test_a_phase_that_wanders_makes_the_frequency_uncertain() -> None:
    """The sd of the frequency is that of a random walk at the end of the record over the duration; the bound of 20 % is
    two sds of its estimate. Mean squares of amplitudes, phases and midlines are 1 with an sd of 0.2. Control: the
    frequency of a phase that does not wander is far more certain."""
    truth, sds = 3 / 1000 / OMEGA, []
    for rms in (0.0, 1.0):
        signal = wandering(rms, 4)
        comparison = viscous_alone(signal)
        averaged = comparison.data.averaged
        assert (averaged.wander > 0) == (rms > 0)
        assert all(r.low < truth < r.high for r in compute_findings(comparison).ratios)
        sds.append(frequency_of(comparison)[1])
        if rms:
            assert sds[1] == pytest.approx(averaged.wander / float(signal.t[-1]), rel=0.2)
            assert np.all((squares(comparison) > 0.4) & (squares(comparison) < 2.0))
    assert sds[1] > 100 * sds[0]


def test_the_walk_of_a_phase_is_estimated_without_bias() -> None:
    """In 16 records, whose 64 blocks each determine it to 9 %, within three standard errors."""
    walks = [prepare_data(wandering(1.0, seed)).averaged for seed in range(16)]
    sizes = [0.0 if averaged is None else averaged.wander for averaged in walks]
    assert np.mean(sizes) == pytest.approx(1.0, abs=3 * 0.09 / 4)


def test_a_record_whose_averaged_motion_is_not_close_is_fitted_by_the_equation_of_motion(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Unless it has very many cycles."""
    signal = closed_form(450)
    assert viscous_alone(signal).averaging is not None
    monkeypatch.setattr("bayesdamp.inference.deviation.averaged.MOST_SHIFT", -1.0)
    assert viscous_alone(signal).data.averaged is None
    monkeypatch.setattr("bayesdamp.inference.deviation.compare.MOST_CYCLES", 400.0)
    assert not viscous_alone(signal).averaging.close


def test_another_form_of_damping_is_fitted_with_its_own_motion() -> None:
    """The damping is c₁v + c₂x²v. Without the correction of its own averaged motion, the right form is 5 nats behind
    viscous + quadratic damping."""
    t = np.linspace(0.0, 436.0, 3490)

    def rates(_: float, state: np.ndarray) -> list[float]:
        x, v = state
        return [v, -((2 * np.pi) ** 2) * x - 4 * np.pi * (0.001 + 0.00267 * x * x) * v]

    motion = solve_ivp(rates, (0.0, t[-1]), [1.0, 0.0], "DOP853", t, rtol=1e-9, atol=1e-12)
    y = motion.y[0] + 0.003 * np.random.default_rng(3).standard_normal(t.size)
    comparison = compare_signal(Signal(t, y, unit="m"), restoring=["linear"])
    assert comparison.data.averaged is not None
    best = comparison.best.log_evidence
    ahead = {"+".join(r.candidate.damping): r.log_evidence - best for r in comparison.forms}
    assert ahead["viscous+displacement"] > 5.0
