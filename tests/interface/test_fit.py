"""A fit against the closed form: values, standard deviations, predictions."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from unittest.mock import Mock

import matplotlib.pyplot as plt
import numpy as np
import pytest
from numpy.typing import ArrayLike

import bayesdamp as bd
from tests.estimators.truths import dry_friction
from tests.interface.problems import MODEL, NOISE, TIMES, TRUTH, closed_form, fit, not_refused, record


def information_sds() -> dict[str, float]:
    """Compute the Cramér-Rao bound of the closed form with white noise by central differences."""
    slopes = []
    for name, value in TRUTH.items():
        h = 1e-5 * max(abs(value), 0.1)
        up, down = ({**TRUTH, name: value + s * h} for s in (1, -1))
        slopes.append((closed_form(TIMES, up) - closed_form(TIMES, down)) / (2 * h))
    covariance = np.linalg.inv(np.array(slopes) @ np.array(slopes).T) * NOISE**2
    return dict(zip(TRUTH, np.sqrt(np.diag(covariance)), strict=True))


def test_values_and_sds_are_those_of_the_closed_form() -> None:
    """Five values within four sds: one false alarm in three thousand seeds. Sds within three sds of the noise level,
    which is inferred to 6 %. Control: a damping that is a fifth larger."""
    assert fit().outcome == "ok"
    assert all(abs(fit().values[n] - v) < 4 * fit().sd[n] for n, v in TRUTH.items())
    assert abs(fit().values["zeta"] - 1.2 * TRUTH["zeta"]) > 8 * fit().sd["zeta"]
    bound = information_sds()
    assert {n: fit().sd[n] for n in bound} == pytest.approx(bound, rel=0.18)


def test_residuals_are_the_record_minus_the_fitted_motion() -> None:
    motion = closed_form(TIMES, {n: fit().values[n] for n in TRUTH})
    assert fit().residuals == pytest.approx(record().y - motion, abs=1e-7)
    assert fit().fitted + fit().residuals == pytest.approx(record().y)
    density = fit().density
    assert fit().log_posterior == pytest.approx(density.log_posterior(density.vector()), abs=1e-5)


@pytest.mark.parametrize(
    "t", [2, [], range(3), [[3.0, 1.0], [2.0, 1.0]], [-1.0, 0.0, 7.0], [9.0, 0.0, 3.0, 12.0, 9.0]], ids=str
)
def test_predictions_are_the_closed_form_at_any_times(t: ArrayLike) -> None:
    """The closed form has the fit's own values. The truth is within four sds of the prediction; control: another ζ."""
    p, h = {n: fit().values[n] for n in TRUTH}, 1e-6
    angle, velocity = fit().predict(t), fit().predict(t, "velocity")
    assert angle.t == pytest.approx(np.ravel(t))
    assert angle.value == pytest.approx(closed_form(angle.t, p), abs=1e-5)
    slope = (closed_form(angle.t + h, p) - closed_form(angle.t - h, p)) / (2 * h)
    assert velocity.value == pytest.approx(slope, abs=1e-5)
    assert (angle.unit, velocity.unit) == ("rad", "rad/s")
    assert angle.sd.shape == angle.t.shape
    assert np.all(np.abs(angle.value - closed_form(angle.t, TRUTH)) < 4 * angle.sd)
    control = np.abs(angle.value - closed_form(angle.t, {**TRUTH, "zeta": 0.06})) > 4 * angle.sd
    assert np.any(control) or not np.any(angle.t > 6)


def test_the_noise_model_is_chosen_from_several() -> None:
    noise = {"noise_sd": 0.003, "noise": "student_t", "noise_dof": 2.0, "seed": 4}
    heavy = bd.simulate({"viscous": 0.05}, stiffness=20.0, duration=6.0, samples=150, **noise)  # type: ignore[arg-type]
    model = bd.Model("viscous", noise=("gaussian", "student_t"))
    assert bd.fit(heavy, model).noise == "student_t"
    assert bd.fit(record(), model).noise == "gaussian"


def test_plots_accept_axes_in_any_array() -> None:
    figure, axes = plt.subplots(2, 2)
    assert fit().plot(ax=axes[0]) == tuple(axes[0])
    assert fit().plot(axes[:, :1]) == (axes[0, 0], axes[1, 0])
    (single,) = fit().plot(axes[1, 1], until=10.0)  # the record with the fit, without the residuals
    assert single is axes[1, 1]
    assert (single.get_xlabel(), len(single.lines)) == ("time / s", 3)
    wrong = {"ax contains 4 axes; give 2": axes, "contains a Figure; it must contain Matplotlib axes": figure}
    assert not_refused((partial(fit().plot, ax), pattern) for pattern, ax in wrong.items()) == []
    assert not_refused([(lambda: record().plot(tuple(axes[0])), "ax contains 2 axes; give 1")]) == []  # type: ignore[arg-type]
    plt.close("all")


def test_intervals_are_normal_in_the_scores() -> None:
    """Under a normal prior value ± 1.96 sd; under a half-normal prior no limit is below zero."""
    value, half = fit().values["theta0"], 1.959964 * fit().sd["theta0"]
    assert fit().intervals["theta0"] == pytest.approx((value - half, value + half))
    assert tuple(fit().summary().loc["theta0", ["low", "high"]]) == fit().intervals["theta0"]
    both = bd.fit(record(), bd.Model("viscous+coulomb", "linear", noise="gaussian", known={"epsilon": 0.02}))
    low, high = both.intervals["mu_c"]
    assert 0 <= low < both.values["mu_c"] < high
    assert "Known: epsilon = 0.02." in repr(both)


@pytest.mark.parametrize("factor", [1.0, 1.1])
def test_a_fit_says_whether_its_model_is_incomplete(factor: float) -> None:
    wrong = bd.Model("viscous", noise="gaussian", known={"stiffness": factor * TRUTH["stiffness"]})
    assert any("times the noise" in note for note in bd.fit(record(), wrong).notes) is (factor > 1)


def test_a_record_without_noise_has_no_fit(tmp_path: Path) -> None:
    result = bd.fit(bd.signal(TIMES, closed_form(TIMES, TRUTH), cleaned=False), MODEL)
    assert result.outcome.startswith("the record has no noise")
    assert not result.values
    assert "no noise" in repr(result)
    post = bd.sample(result)
    assert post.outcome == bd.evidence(post).outcome == result.outcome
    assert bd.Fit.load(result.save(tmp_path / "none")).outcome == result.outcome
    for attempt in (lambda: result.density, lambda: result.predict([1.0]), lambda: post.data, result.plot):
        with pytest.raises(bd.Refusal, match="no noise"):
            attempt()


def test_a_record_without_an_oscillation_has_no_fit() -> None:
    noise = bd.signal(TIMES, np.random.default_rng(0).standard_normal(TIMES.size), cleaned=False)
    assert bd.fit(noise, MODEL).outcome == "no oscillation stands out of the noise"
    assert bd.estimate(noise, "koopman", MODEL).outcome != "ok"


def test_a_given_start_is_used_if_the_least_squares_fit_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    expected, refuse = fit().values, Mock(side_effect=bd.Refusal("no solution stays in phase"))
    monkeypatch.setattr("bayesdamp.interface.model.compare_candidates", refuse)
    assert bd.fit(record(), MODEL).outcome == "no solution stays in phase"
    started = bd.fit(record(), MODEL, start=TRUTH)
    assert started.values == pytest.approx(expected, rel=1e-6, abs=1e-7)
    assert started.notes[0].endswith(" start, with gaussian noise, because no solution stays in phase.")


REFUSED: dict[str, Callable[[], object]] = {
    "did you mean 'zeta'": lambda: bd.fit(record(), MODEL, start={"zet": 1.0}),
    "must be a Posterior or a Fit": lambda: bd.evidence(record()),  # type: ignore[arg-type]
    "did you mean 'nuts'": lambda: bd.sample(fit(), "nut"),
    "sample.draws: is 1; it must be a whole number from 10 to 10,000,000": lambda: bd.sample(fit(), draws=1),
    "did you mean 'koopman'": lambda: bd.estimate(record(), "kopman", MODEL),
    "t must be finite times": lambda: fit().predict([np.nan]),
    "did you mean 'angle'": lambda: fit().predict([1.0], "angel"),
    "law pendulum needs an angle; restoring can be duffing, linear": lambda: bd.fit(
        bd.signal(TIMES, record().y, unit="mm", cleaned=False), bd.Model("viscous", "pendulum")
    ),
}


def test_misuse_is_refused_in_one_line() -> None:
    assert not_refused((call, pattern) for pattern, call in REFUSED.items()) == []


def test_the_width_of_friction_is_chosen_also_with_a_single_noise_model() -> None:
    """Exact dry friction of 0.2 in closed form, with noise. Control: a width of 2 % of the peak velocity fits worse."""
    clean, _ = dry_friction()
    noise = 1e-3 * np.random.default_rng(4).standard_normal(clean.t.size)
    signal = bd.signal(clean.t, clean.y + noise, name="dry friction", cleaned=False)
    known = {"stiffness": 25.0, "rest_angle": 0.0}
    both = known, known | {"epsilon": 0.02 * 0.4 * 5.0}
    models = (bd.Model("coulomb", "linear", noise="gaussian", known=values) for values in both)
    chosen, wide = (bd.fit(signal, model) for model in models)
    assert any("was not given" in note for note in chosen.notes)
    assert abs(chosen.values["mu_c"] - 0.2) < 4 * chosen.sd["mu_c"]
    assert wide.log_posterior < chosen.log_posterior - 3
