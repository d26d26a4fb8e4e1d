"""Where searches for a mode start, and which of several starts they take."""

from __future__ import annotations

import numpy as np
import pytest

from bayesdamp.config.compare import Asked, comparison
from bayesdamp.inference import mode as modes
from bayesdamp.inference.mode import find_mode
from bayesdamp.store import Store
from bayesdamp.study.records import SignalCell
from bayesdamp.study.starts import OBSERVED, observed, regression
from bayesdamp.study.targets import Record
from bayesdamp.types import Problem, Refusal

FREQUENCY, RATE = 2 * np.pi * 0.3, 0.02


@pytest.fixture(scope="module")
def record(tmp_path_factory) -> Record:
    """An accelerometer on a tower: 24 cycles whose noise, differentiated twice over, hides the regression's terms."""
    folder = tmp_path_factory.mktemp("tower")
    t = np.arange(0, 80, 0.05)
    y = 0.05 * np.exp(-RATE * t) * np.cos(FREQUENCY * t) + 0.005 * np.random.default_rng(4).standard_normal(
        t.size
    )
    np.savetxt(folder / "tower.csv", np.c_[t, y], delimiter=",", header="t,a", comments="")
    study = comparison([Asked(folder / "tower.csv", "t", "a", quantity="acceleration")])
    store = Store(folder / "out")
    cell = SignalCell(study, study.signals[0], 0, store)
    cell.compute()
    return Record(study, study.signals[0], store.read(cell.name))


def test_the_record_itself_says_where_to_start(record) -> None:
    """Truth from the closed form of the damped cosine. Negative control: the regression is lost."""
    problem = Problem(("viscous", "coulomb"), record.system("linear"))
    (values,) = observed(record, problem).values()
    assert values["stiffness"] == pytest.approx(FREQUENCY**2, rel=0.02)
    assert values["zeta"] < 2 * RATE
    (lost,) = regression(record, problem)[0].values()
    assert not 0.5 * FREQUENCY**2 < lost["stiffness"] < 2 * FREQUENCY**2


@pytest.mark.parametrize("damping", [("viscous",), ("coulomb",), ("viscous", "coulomb", "quadratic")])
def test_no_damping_misses_its_mode_on_a_noisy_acceleration(record, damping) -> None:
    target = record.target(damping, "linear", "gaussian")
    problem = Problem(damping, record.system("linear"))
    seeds = observed(record, problem) | regression(record, problem)[0]
    found = find_mode(target, seeds, noise_level=record.seen.roughness, thrifty=True)
    assert [c.seed for c in found.climbs] == [OBSERVED]  # it keeps step: the other need not be climbed from
    assert float(target.values(found.z)["stiffness"]) == pytest.approx(FREQUENCY**2, rel=0.01)
    # Negative control: from the regression alone another mode is found, far below, where frequencies differ.
    alone = find_mode(target, regression(record, problem)[0], noise_level=record.seen.roughness)
    if damping == ("coulomb",):
        assert found.log_posterior >= alone.log_posterior - 1e-3
    else:
        assert found.log_posterior > alone.log_posterior - 1e-3


def test_starts_that_do_not_keep_step_are_climbed_from_in_their_order(record) -> None:
    target = record.target(("viscous",), "linear", "gaussian")
    wrong = {"stiffness": 0.1 * FREQUENCY**2, "zeta": RATE, "theta0": -0.014}
    right = {"stiffness": FREQUENCY**2, "zeta": RATE, "theta0": -0.014, "rest_angle": 0.0}
    level = record.seen.roughness
    both = find_mode(target, {"wrong": wrong, "right": right}, noise_level=level, thrifty=True)
    assert [c.seed for c in both.climbs] == ["right"]
    lost = find_mode(
        target, {"wrong": wrong, "worse": {**wrong, "zeta": 0.0}}, noise_level=level, thrifty=True
    )
    assert [c.seed for c in lost.climbs] == ["wrong", "worse"]
    every = find_mode(target, {"wrong": wrong, "right": right}, noise_level=level)
    assert [c.seed for c in every.climbs] == ["wrong", "right"]


def test_a_mode_without_curvature_gives_way_to_the_next(record, monkeypatch) -> None:
    target = record.target(("viscous",), "linear", "gaussian")
    right = {"stiffness": FREQUENCY**2, "zeta": RATE, "theta0": -0.014, "rest_angle": 0.0}
    seeds = {"right": right, "wrong": {**right, "stiffness": 0.1 * FREQUENCY**2}}
    settle, asked = modes._settle, []

    def refusing(target, z, *rest):
        asked.append(z)
        if len(asked) == 1:
            raise Refusal("the posterior has no curvature at its mode")
        return settle(target, z, *rest)

    monkeypatch.setattr(modes, "_settle", refusing)
    found = find_mode(target, seeds, noise_level=record.seen.roughness)
    assert len(asked) == 2
    assert np.max(np.abs(asked[0] - asked[1])) > 0.1
    assert found.log_posterior < max(c.end for c in found.climbs)
    monkeypatch.setattr(modes, "_settle", lambda *_: (_ for _ in ()).throw(Refusal("no curvature")))
    with pytest.raises(Refusal, match="no curvature"):
        find_mode(target, seeds, noise_level=record.seen.roughness)
