"""Evidence against quadrature over the natural parameters, with a likelihood by other means."""

from __future__ import annotations

from functools import lru_cache

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import logsumexp

from bayesdamp.inference.evidence import EVIDENCES, EvidenceMethod
from bayesdamp.inference.evidence.importance import FoldedT
from bayesdamp.inference.mode import Mode, find_mode
from bayesdamp.inference.target import Target, compiled
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.priors import HalfNormal, LogNormal
from bayesdamp.types import Evidence, Signal

KNOWN = {"stiffness": 20.0, "rest_angle": 0.0, "epsilon": 0.1, "theta0": 0.3, "omega0": 0.0, "noise_sd": 0.02}
TIMES = np.linspace(0.0, 6.0, 151)
LIMIT = 0.05
"""nats"""


def trajectories(zeta: np.ndarray, mu_c: np.ndarray, substeps: int = 20) -> np.ndarray:
    """θ at TIMES of many parameter sets, shape (m, n): classical Runge–Kutta in NumPy, here within 1e-8 rad."""
    k, eps = KNOWN["stiffness"], KNOWN["epsilon"]

    def slope(state):
        x, v = state
        return np.stack([v, -2 * zeta * v - mu_c * np.tanh(v / eps) - k * x])

    state = np.stack([np.full(zeta.shape, KNOWN["theta0"]), np.full(zeta.shape, KNOWN["omega0"])])
    out = [state[0]]
    h = (TIMES[1] - TIMES[0]) / substeps
    for _ in range(TIMES.size - 1):
        for _ in range(substeps):
            k1 = slope(state)
            k2 = slope(state + 0.5 * h * k1)
            k3 = slope(state + 0.5 * h * k2)
            k4 = slope(state + h * k3)
            state = state + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        out.append(state[0])
    return np.stack(out, axis=-1)


def record(zeta: float, mu_c: float, seed: int) -> np.ndarray:
    clean = trajectories(np.array([zeta]), np.array([mu_c]))[0]
    return clean + KNOWN["noise_sd"] * np.random.default_rng(seed).standard_normal(TIMES.size)


def grid(low: float, high: float, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Gauss–Legendre nodes and weights between low and high."""
    x, w = np.polynomial.legendre.leggauss(count)
    return low + 0.5 * (high - low) * (x + 1), 0.5 * (high - low) * w


def log_densities(y: np.ndarray, zeta: np.ndarray, mu_c: np.ndarray, sd: np.ndarray) -> np.ndarray:
    """Normal log likelihoods of y over matching arrays, shape (m,)."""
    square = np.sum((y - trajectories(zeta, mu_c)) ** 2, axis=-1)
    return -0.5 * square / sd**2 - y.size * np.log(sd * np.sqrt(2 * np.pi))


CASES = {
    # two coefficients, friction truly absent: its posterior sits at zero
    "touching": (("viscous", "coulomb"), record(0.06, 0.0, 3), {"zeta": 0.06, "mu_c": 0.01}),
    # friction and the noise, both far from their ends
    "far": (("coulomb",), record(0.0, 0.12, 4), {"mu_c": 0.11}),
}


@lru_cache
def problem(case: str) -> tuple[Target, Mode]:
    damping, y, seed = CASES[case]
    priors = {"zeta": HalfNormal(scale=0.45), "mu_c": HalfNormal(scale=0.9)}
    osc = Oscillator(damping, "linear")
    priors = {n: priors[n] for n in osc.coefficients}
    known = dict(KNOWN)
    if case == "far":
        priors["noise_sd"] = LogNormal(median=0.01, sigma=1.0)  # type: ignore[assignment]
        del known["noise_sd"]
    target = Target(Signal(TIMES, y), osc, "gaussian", priors, known)  # type: ignore[arg-type]
    return target, find_mode(target, {"s": seed}, noise_level=KNOWN["noise_sd"])


@lru_cache
def quadrature(case: str) -> float:
    """log ∫ prior · likelihood over two natural parameters by products of Gauss–Legendre rules."""
    target, _ = problem(case)
    _, y, _ = CASES[case]
    if case == "touching":
        (a, wa), (b, wb) = grid(0.0, 0.14, 32), grid(0.0, 0.16, 32)
        names = ("zeta", "mu_c")
    else:
        (a, wa), (b, wb) = grid(0.02, 0.25, 32), grid(0.014, 0.03, 32)
        names = ("mu_c", "noise_sd")
    first, second = (m.ravel() for m in np.meshgrid(a, b, indexing="ij"))
    if case == "touching":
        logs = log_densities(y, first, second, np.full(first.size, KNOWN["noise_sd"]))
    else:
        motion = log_densities(y, np.zeros(a.size), a, np.full(a.size, 1.0))
        square = -2 * (motion + y.size * np.log(np.sqrt(2 * np.pi)))
        logs = -0.5 * np.repeat(square, b.size) / second**2 - y.size * np.log(second * np.sqrt(2 * np.pi))
    prior = np.asarray(
        target.priors[names[0]].log_density(first) + target.priors[names[1]].log_density(second)
    )
    weights = np.outer(wa, wb).ravel()
    edge = (logs + prior).reshape(a.size, b.size)
    outer = max(
        edge[-1].max(), edge[:, -1].max(), *([] if case == "touching" else [edge[0].max(), edge[:, 0].max()])
    )
    assert outer < edge.max() - 12, "the grid cuts the posterior"
    return float(logsumexp(logs + prior, b=weights))


def test_the_two_likelihoods_agree():
    for case in CASES:
        target, mode = problem(case)
        p = target.all_values(mode.z)
        y = CASES[case][1]
        zeta, mu_c, sd = (np.array([p.get(n, 0.0)]) for n in ("zeta", "mu_c", "noise_sd"))
        ours = compiled(target.layout).batch_parts(mode.context, jnp.asarray(mode.z[None]))[0]
        assert float(ours[0]) == pytest.approx(log_densities(y, zeta, mu_c, sd)[0], abs=0.01)


def test_the_case_does_touch_zero():
    target, mode = problem("touching")
    i = target.names.index("mu_c")
    assert mode.z[i] < 1.5 * mode.sd()[i]
    target, mode = problem("far")
    assert mode.z[0] > 6 * mode.sd()[0]


@lru_cache
def evidence(case: str, method: str, seed: int = 1) -> Evidence:
    target, mode = problem(case)
    return EVIDENCES.get(method).evidence("model", target, mode, seed)


@pytest.mark.parametrize("method", EVIDENCES.names())
@pytest.mark.parametrize("case", CASES)
def test_against_quadrature(case, method):
    found = evidence(case, method)
    assert found.outcome == "ok", found
    assert abs(found.log_evidence - quadrature(case)) < LIMIT
    assert found.stderr < LIMIT / 2


@pytest.mark.parametrize("method", EVIDENCES.names())
def test_contract(method):
    plugin = EVIDENCES.get(method)
    assert isinstance(plugin, EvidenceMethod)
    assert plugin.name == method
    found, other = evidence("far", method), evidence("far", method, 2)
    assert found.method == method
    assert found.model == "model"
    assert found.diagnostic
    assert found.evaluations > 0
    target, mode = problem("far")
    again = plugin.evidence("model", target, mode, 1)
    assert again.log_evidence == found.log_evidence
    assert again.stderr == found.stderr
    assert other.log_evidence != found.log_evidence
    # Two seeds within five standard errors of each other: false-alarm rate below 1e-6.
    assert abs(other.log_evidence - found.log_evidence) < 5 * np.hypot(found.stderr, other.stderr)


def test_stated_error_is_honest():
    """Thirty seeds on one target: their scatter is the stated standard error (99.9 % bounds of chi²/29)."""
    values = [evidence("touching", "importance", seed) for seed in range(30)]
    ratio = np.var([v.log_evidence for v in values], ddof=1) / np.mean([v.stderr**2 for v in values])
    assert 0.40 < ratio < 2.1


@pytest.mark.parametrize("case", CASES)
def test_negative_control_no_mirror_images(case):
    """A proposal on one side of an unfolded score: log 2 is lost where the coefficient is far from zero, unseen
    by the weights; near zero what is lost is some part of it."""
    target, mode = problem(case)
    proposal = FoldedT(mode.z, mode.factor, np.zeros(mode.z.size, bool))
    z = proposal.draw(np.random.default_rng(1), 4000)
    weights = np.asarray(compiled(target.layout).batch(mode.context, jnp.asarray(z))) - proposal.log_density(
        z
    )
    found = float(logsumexp(weights) - np.log(weights.size))
    if case == "far":
        assert quadrature(case) - found == pytest.approx(np.log(2), abs=LIMIT)
    assert abs(found - quadrature(case)) > LIMIT


def test_negative_control_draws_folded_density_not():
    """Folding the draws but not the proposal's density claims too much where the posterior touches zero."""
    target, mode = problem("touching")
    folded = np.asarray(target.layout.folded)
    proposal = FoldedT(mode.z, mode.factor, folded)
    z = proposal.draw(np.random.default_rng(1), 4000)
    one_sided = FoldedT(mode.z, mode.factor, np.zeros(mode.z.size, bool))
    posterior = np.asarray(
        compiled(target.layout).batch(mode.context, jnp.asarray(z))
    ) + folded.sum() * np.log(2)
    found = float(logsumexp(posterior - one_sided.log_density(z)) - np.log(z.shape[0]))
    assert found - quadrature("touching") > LIMIT
