"""Coordinates in which a spring, gravity and the spring's angle are straight, and motions no closer than noise asks."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from bayesdamp.inference.deviation import sampling
from bayesdamp.inference.deviation.parameters import Straight, straight_at
from bayesdamp.inference.deviation.quick import weighing_of
from bayesdamp.inference.deviation.sampling import APART, LOOSER, DrawMotions, motions_near, reference_of
from bayesdamp.inference.deviation.weighing import CandidateResult, Weighing
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.physics.restoring import LAWS
from bayesdamp.records.simulate import simulate_signal
from bayesdamp.types import Reference, Signal

TRUTH = {
    "stiffness": 60.0, "gravity": 12.0, "spring_angle": 0.2, "zeta": 0.08, "epsilon": 0.01,
    "theta0": 0.46, "omega0": 0.0,
}  # fmt: skip
"""Swings of 0.07 rad, which tell the angle at rest and the frequency, and hardly the gravity in them."""
NOISE = 4e-4


@cache
def record() -> Signal:
    osc = Oscillator(("viscous",), "horizontal_pendulum")
    return simulate_signal(
        osc, TRUTH, duration=12.0, samples=700, noise_sd=NOISE, rng=np.random.default_rng(5)
    )


@cache
def weighed() -> tuple[Weighing, CandidateResult]:
    return of(record())


def of(signal: Signal, scales: Reference | None = None, **known: float) -> tuple[Weighing, CandidateResult]:
    weighing = weighing_of(
        signal,
        damping=["viscous"],
        restoring=["horizontal_pendulum"],
        known={"noise_sd": NOISE, **known},
        reference=scales,
    )
    return weighing, weighing.results[0]


def coordinates() -> tuple[Straight, np.ndarray]:
    _, result = weighed()
    z = result.fit.z
    found = straight_at(result.fit.parameters, "horizontal_pendulum", z)
    assert found is not None
    return found, z


def test_they_are_the_scores_at_the_anchor_to_first_order() -> None:
    found, z = coordinates()
    np.testing.assert_allclose(found.values(z), super(Straight, found).values(z), rtol=1e-9)
    for i in found.places:
        ends = [found.plain(z + sign * 1e-5 * (np.arange(z.size) == i)) for sign in (1, -1)]
        np.testing.assert_allclose((ends[0] - ends[1]) / 2e-5, np.arange(z.size) == i, atol=1e-4)


def test_the_prior_keeps_its_density() -> None:
    """The determinant agrees with differences of the scores."""
    found, z = coordinates()
    rng = np.random.default_rng(2)
    for _ in range(5):
        at = z + 0.2 * rng.standard_normal(z.size)
        columns = [(found.plain(at + 1e-5 * e) - found.plain(at - 1e-5 * e)) / 2e-5 for e in np.eye(z.size)]
        wanted = np.log(abs(np.linalg.det(np.array(columns).T)))
        wanted += 0.5 * np.sum(at**2) - 0.5 * np.sum(found.plain(at) ** 2)
        assert found.log_prior_ratio(at) == pytest.approx(wanted, abs=1e-4)
    assert abs(wanted) > 0.01  # else it would be none


def test_where_a_parameter_is_known_there_are_none() -> None:
    _, result = weighed()
    parameters = result.fit.parameters
    priors = {n: p for n, p in parameters.priors.items() if n != "gravity"}
    fewer = replace(parameters, priors=priors, known={**parameters.known, "gravity": 10.0})
    assert straight_at(fewer, "horizontal_pendulum", np.zeros(len(priors))) is None


def test_evidence_is_that_of_quadrature_over_gravity(monkeypatch: pytest.MonkeyPatch) -> None:
    """With gravity known everything else is well determined, and its linear model is right; the quadrature is over
    gravity's prior.

    The evidence agrees within a tenth of a nat, and gravity's mean within five standard errors (false alarm 1 in 1.7
    million). Control: draws that start from the linear model of the scores miss it by nats.
    """
    weighing, result = weighed()
    place = result.fit.parameters.free_names.index("gravity")
    prior = result.fit.parameters.priors["gravity"]
    found = sampling.sampled_result(weighing, result).sampled
    assert found is not None
    drawn = prior.value(found.draws[:, place])
    grid = np.linspace(drawn.mean() - 5 * drawn.std(), drawn.mean() + 5 * drawn.std(), 13)
    logs = [of(record(), weighing.reference, gravity=float(g))[1].log_evidence for g in grid]
    density = np.exp(np.array(logs) + prior.log_density(grid) - max(logs))
    whole = np.trapezoid(density, grid)
    assert found.log_evidence == pytest.approx(np.log(whole) + max(logs), abs=0.1)
    mean = np.trapezoid(density * grid, grid) / whole
    assert drawn.mean() == pytest.approx(mean, abs=5 * drawn.std() / np.sqrt(found.draws.shape[0] / 2))
    monkeypatch.setattr(sampling, "_straightened", lambda *_: None)
    plain = sampling.sampled_result(weighing, result).sampled
    assert plain is not None
    assert abs(plain.log_evidence - np.log(whole) - max(logs)) > 1.0


def test_looser_motions_are_as_near_as_they_say() -> None:
    """This holds for other draws than those that were tried; control: without the correction they are further off."""
    weighing, result = weighed()
    start = reference_of(weighing, result)
    sd = float(np.sqrt(weighing.variance))
    found = motions_near(result, start.parameters, start.weighed)
    assert found.tolerance in LOOSER
    rows = start.weighed.draws(start.parameters.positive, 20, np.random.default_rng(9))[0]
    close = DrawMotions(result.solver, start.parameters, result.fit.active, 1e-10)
    bare = replace(found, correction=0.0)

    def off(motions: DrawMotions) -> float:
        pairs = [(motions.at(row), close.at(row)) for row in rows]
        return max(float(np.linalg.norm(a - b)) / sd for a, b in pairs if a is not None and b is not None)

    assert off(found) < 2 * APART
    assert off(bare) > 5 * off(found)


def test_a_step_along_gravity_keeps_what_the_record_tells() -> None:
    """Angle at rest and frequency stay the same along their tangent; control: along the scores they change."""
    _, result = weighed()
    parameters, z = result.fit.parameters, result.fit.z
    found, law = coordinates()[0], LAWS.get("horizontal_pendulum")
    step = np.linalg.inv(found.root)[:, found.at.index("gravity")]
    new = z.copy()
    new[found.places] += 10.0 * step

    def told(scores: np.ndarray) -> np.ndarray:
        p = dict(zip(parameters.names, map(float, parameters.values(scores)), strict=True))
        natural = law.natural(p)
        assert natural is not None
        return np.array([natural[n] for n in ("stiffness", "spring_angle", "theta0")])

    along = told(parameters.retracted("horizontal_pendulum", z, new))
    np.testing.assert_allclose(along, told(z), rtol=1e-6)
    assert np.max(np.abs(told(new) / told(z) - 1)) > 1e-3
