"""A fit against the closed form: values, standard deviations, what lies beyond the record."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest
from numpy.typing import ArrayLike

import bayesdamp as bd
from tests.estimators.truths import dry_friction
from tests.interface.problems import MODEL, NOISE, TIMES, TRUTH, closed_form, fit, not_refused, record


def information_sds() -> dict[str, float]:
    """Cramér and Rao's bound of the closed form with white noise, by central differences."""
    slopes = []
    for name, value in TRUTH.items():
        h = 1e-5 * max(abs(value), 0.1)
        up, down = ({**TRUTH, name: value + s * h} for s in (1, -1))
        slopes.append((closed_form(TIMES, up) - closed_form(TIMES, down)) / (2 * h))
    covariance = np.linalg.inv(np.array(slopes) @ np.array(slopes).T) * NOISE**2
    return dict(zip(TRUTH, np.sqrt(np.diag(covariance)), strict=True))


def test_the_truth_is_within_its_error() -> None:
    """Five values within four sds: a false alarm in three thousand."""
    assert fit().outcome == "ok"
    away = {n: abs(fit().values[n] - v) / fit().sd[n] for n, v in TRUTH.items()}
    assert max(away.values()) < 4
    # The negative control.
    assert abs(fit().values["zeta"] - 1.2 * TRUTH["zeta"]) > 8 * fit().sd["zeta"]


def test_sds_are_those_of_the_information() -> None:
    """The noise's level is itself inferred, to 6 %: three of its sds."""
    bound = information_sds()
    assert {n: fit().sd[n] for n in bound} == pytest.approx(bound, rel=0.18)


def test_residuals_are_the_noise() -> None:
    clean = closed_form(TIMES, {n: fit().values[n] for n in TRUTH})
    assert fit().residuals == pytest.approx(record().y - clean, abs=1e-7)
    assert fit().fitted + fit().residuals == pytest.approx(record().y)
    density = fit().density
    assert fit().log_posterior == pytest.approx(density.log_posterior(density.vector()), abs=1e-5)


@pytest.mark.parametrize("quantity", ["angle", "velocity"])
def test_beyond_the_record(quantity: str) -> None:
    """The closed form at the fit's own values; and the truth within four of the prediction's sds at the end."""
    t = np.array([9.0, 0.0, 3.0, 12.0, 9.0])
    p = {n: fit().values[n] for n in TRUTH}
    found, h = fit().predict(t, quantity), 1e-6
    slope = (closed_form(t + h, p) - closed_form(t - h, p)) / (2 * h)
    expected = closed_form(t, p) if quantity == "angle" else slope
    assert found.value == pytest.approx(expected, abs=1e-5)
    assert found.unit == {"angle": "rad", "velocity": "rad/s"}[quantity]
    if quantity == "angle":
        assert np.all(np.abs(found.value - closed_form(t, TRUTH)) < 4 * found.sd)
        assert not np.all(np.abs(found.value - closed_form(t, {**TRUTH, "zeta": 0.06})) < 4 * found.sd)


def test_times_of_any_kind() -> None:
    """Numbers, whole numbers, any order and shape, and before the record."""
    p = {n: fit().values[n] for n in TRUTH}
    kinds: list[ArrayLike] = [2, [], range(3), [[3.0, 1.0], [2.0, 1.0]], [-1.0, 0.0, 7.0]]
    for t in kinds:
        found = fit().predict(t)
        assert found.t == pytest.approx(np.ravel(t))
        assert found.value == pytest.approx(closed_form(found.t, p), abs=1e-5)
        assert found.sd.shape == found.t.shape


def test_the_noise_is_chosen_where_it_is_asked_for() -> None:
    noise = {"noise_sd": 0.003, "noise": "student_t", "noise_dof": 2.0, "seed": 4}
    heavy = bd.simulate({"viscous": 0.05}, stiffness=20.0, duration=6.0, samples=150, **noise)  # type: ignore[arg-type]
    model = bd.Model("viscous", noise=("gaussian", "student_t"))
    assert bd.fit(heavy, model).noise == "student_t"
    assert bd.fit(record(), model).noise == "gaussian"


def test_axes_are_taken_as_a_user_has_them() -> None:
    figure, four = plt.subplots(2, 2)
    assert fit().plot(ax=four[0]) == tuple(four[0])
    assert fit().plot(four[:, :1]) == (four[0, 0], four[1, 0])
    (alone,) = fit().plot(four[1, 1], until=10.0)  # the record with the fit, without the residuals
    assert alone is four[1, 1]
    assert (alone.get_xlabel(), len(alone.lines)) == ("time / s", 3)
    wrong = {"ax contains 4 axes; give 2": four, "contains a Figure; it must contain Matplotlib axes": figure}
    assert not_refused((partial(fit().plot, given), said) for said, given in wrong.items()) == []
    assert not_refused([(lambda: record().plot(tuple(four[0])), "ax contains 2 axes; give 1")]) == []  # type: ignore[arg-type]
    plt.close("all")


def test_intervals_are_the_normal_ones_of_the_scores() -> None:
    """Of a normal prior, value ± 1.96 sd; of a half-normal one none is below zero."""
    low, high = fit().intervals["theta0"]
    half = 1.959964 * fit().sd["theta0"]
    assert (low, high) == pytest.approx((fit().values["theta0"] - half, fit().values["theta0"] + half))
    both = bd.fit(record(), bd.Model("viscous+coulomb", "linear", noise="gaussian", known={"epsilon": 0.02}))
    assert both.intervals["mu_c"][0] >= 0
    assert both.intervals["mu_c"][0] < both.values["mu_c"] < both.intervals["mu_c"][1]


def test_without_noise_the_outcome_says_so(tmp_path: Path) -> None:
    clean = bd.signal(TIMES, closed_form(TIMES, TRUTH), cleaned=False)
    found = bd.fit(clean, MODEL)
    assert found.outcome.startswith("the record has no noise")
    assert not found.values
    assert "no noise" in repr(found)
    post = bd.sample(found)
    assert post.outcome == bd.evidence(post).outcome == found.outcome
    assert bd.Fit.load(found.save(tmp_path / "none")).outcome == found.outcome
    for attempt in (lambda: found.density, lambda: found.predict([1.0]), lambda: post.data, found.plot):
        with pytest.raises(bd.Refusal, match="no noise"):
            attempt()


def test_without_an_oscillation_the_outcome_says_so() -> None:
    noise = np.random.default_rng(0).standard_normal(TIMES.size)
    found = bd.fit(bd.signal(TIMES, noise, cleaned=False), MODEL)
    assert found.outcome == "no oscillation stands out of the noise"
    assert bd.estimate(bd.signal(TIMES, noise, cleaned=False), "koopman", MODEL).outcome != "ok"


WRONG: dict[str, Callable[[], object]] = {
    "did you mean 'zeta'": lambda: bd.fit(record(), MODEL, start={"zet": 1.0}),
    "must be a Posterior or a Fit": lambda: bd.evidence(record()),  # type: ignore[arg-type]
    "did you mean 'nuts'": lambda: bd.sample(fit(), "nut"),
    "draws is 1; it must be a whole number, 10 or more": lambda: bd.sample(fit(), draws=1),
    "did you mean 'bridge'": lambda: bd.evidence(fit(), "brige"),
    "did you mean 'koopman'": lambda: bd.estimate(record(), "kopman", MODEL),
    "t must be finite times": lambda: fit().predict([np.nan]),
    "did you mean 'angle'": lambda: fit().predict([1.0], "angel"),
    "but pendulum describes an angle; restoring can be duffing, linear": lambda: bd.fit(
        bd.signal(TIMES, record().y, unit="mm", cleaned=False), bd.Model("viscous", "pendulum")
    ),
}


def test_misuse_is_one_line() -> None:
    assert not_refused((call, line) for line, call in WRONG.items()) == []


def test_the_width_of_friction_is_chosen_also_under_one_noise_model() -> None:
    """Exact dry friction of 0.2 in closed form, with noise: the chosen width is far below 2 % of the peak velocity."""
    clean, _ = dry_friction()
    noise = 1e-3 * np.random.default_rng(4).standard_normal(clean.t.size)
    signal = bd.signal(clean.t, clean.y + noise, name="dry friction", cleaned=False)
    known = {"stiffness": 25.0, "rest_angle": 0.0}
    own = bd.fit(signal, bd.Model("coulomb", "linear", noise="gaussian", known=known))
    assert any("was not given" in note for note in own.notes)
    assert abs(own.values["mu_c"] - 0.2) < 4 * own.sd["mu_c"]
    usual = bd.Model("coulomb", "linear", noise="gaussian", known={**known, "epsilon": 0.02 * 0.4 * 5.0})
    assert bd.fit(signal, usual).log_posterior < own.log_posterior - 3
