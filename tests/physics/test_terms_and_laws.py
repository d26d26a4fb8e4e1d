"""Damping terms and restoring laws: the contract of every plug-in, and closed forms."""

from __future__ import annotations

import itertools
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad

from bayesdamp.physics.damping import TERMS, DampingTerm, all_sums, model_name, parse_model
from bayesdamp.physics.elementary import cosine, sine, smooth_sign
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.physics.restoring import LAWS as LAW_PLUGINS
from bayesdamp.physics.restoring import RestoringLaw
from bayesdamp.types import InputError
from tests.physics.independent import LAWS, drag, restoring

GRID = np.linspace(-0.6, 0.7, 57)


@pytest.mark.parametrize("name", TERMS.names())
def test_contract_of_a_term(name):
    term = TERMS.get(name)
    assert isinstance(term, DampingTerm)
    assert term.name == name
    assert term.parameter
    assert term.unit
    v = jnp.asarray(np.linspace(-3, 3, 13))
    for epsilon in (0.0, 1e-3, 0.1) if term.switches else (0.1,):
        force = np.asarray(term.shape(v, epsilon))
        assert force.shape == v.shape
        assert np.all(force * np.asarray(v) >= 0)  # takes energy out
        np.testing.assert_allclose(force, -force[::-1], atol=5e-13)  # no side is preferred
    assert np.all(np.isfinite(np.asarray(jax.vmap(jax.grad(lambda x: term.shape(x, 0.1)))(v))))


@pytest.mark.parametrize("name", TERMS.names())
@pytest.mark.parametrize(("amplitude", "frequency"), [(0.3, 4.47), (1.7, 0.6)])
def test_equivalent_ratio(name, amplitude, frequency):
    """Energy lost in a cycle of a harmonic motion, by quadrature, over that of a viscous ratio of 1."""
    term = TERMS.get(name)

    def power(t: float) -> float:
        v = -amplitude * frequency * math.sin(frequency * t)
        return float(term.shape(v, 0.0 if term.switches else 1.0)) * v

    quarter = math.pi / 2 / frequency
    lost = 4 * quad(power, 0, quarter, epsabs=1e-12, epsrel=1e-10, limit=20)[0]
    expected = lost / (2 * math.pi * frequency**2 * amplitude**2)
    assert term.ratio_per_unit(amplitude, frequency) == pytest.approx(expected, rel=1e-7)


@pytest.mark.parametrize("model", all_sums())
def test_force_of_every_sum(model):
    osc = Oscillator(parse_model(model), "linear")
    p = {
        n: v
        for n, v in {"zeta": 0.4, "mu_c": 0.3, "mu_q": 0.2, "epsilon": 0.1}.items()
        if n in osc.parameters
    }
    expected = [drag(p)(float(v), 0.0) for v in GRID]
    np.testing.assert_allclose(np.asarray(osc.damping_force(jnp.asarray(GRID), p)), expected, atol=1e-12)


def test_smooth_sign():
    """tanh within 2e-13 everywhere, its slope, and ±1 at infinity."""
    x = np.concatenate([np.linspace(-40, 40, 8001), np.logspace(-14, 3, 300), [0.0, 1e300, -1e300]])
    np.testing.assert_allclose(np.asarray(smooth_sign(jnp.asarray(x))), np.tanh(x), atol=2e-13, rtol=0)
    slope = np.asarray(jax.vmap(jax.grad(smooth_sign))(jnp.asarray(x)))
    np.testing.assert_allclose(slope, 1 - np.tanh(x) ** 2, atol=5e-13)


@pytest.mark.parametrize(
    ("ours", "theirs", "slope"), [(cosine, np.cos, lambda x: -np.sin(x)), (sine, np.sin, np.cos)]
)
def test_sine_and_cosine(ours, theirs, slope):
    """Within 1e-14 over a few turns, 2e-13 at a thousand radians; so are the tangents."""
    for reach, limit in ((12.0, 1e-14), (1e3, 2e-13)):
        x = np.linspace(-reach, reach, 4801)
        np.testing.assert_allclose(np.asarray(ours(jnp.asarray(x))), theirs(x), atol=limit, rtol=0)
        tangents = np.asarray(jax.vmap(jax.grad(ours))(jnp.asarray(x)))
        np.testing.assert_allclose(tangents, slope(x), atol=limit, rtol=0)
    assert not np.any(np.isfinite(np.asarray(ours(jnp.asarray([np.inf, np.nan])))))


def test_names_of_models():
    assert parse_model("viscous + coulomb") == ("viscous", "coulomb")
    assert model_name(("viscous", "coulomb")) == "viscous+coulomb"
    for wrong in ("viscous+viscous", "", "viscous+"):
        with pytest.raises(InputError, match="sum of different terms"):
            parse_model(wrong)
    with pytest.raises(InputError, match="did you mean 'viscous'"):
        parse_model("viscos")


@pytest.mark.parametrize("name", LAW_PLUGINS.names())
def test_contract_of_a_law(name):
    law, p = LAW_PLUGINS.get(name), LAWS[name]
    assert isinstance(law, RestoringLaw)
    assert law.name == name
    assert set(law.parameters) <= set(p)
    assert all(law.unit(n) for n in law.parameters)
    expected = [restoring(name, p)(float(x)) for x in GRID]
    np.testing.assert_allclose(np.asarray(law.force(GRID, p)), expected, atol=1e-13)


@pytest.mark.parametrize("name", LAW_PLUGINS.names())
def test_linear_form_finds_what_is_free(name):
    """Whatever part of the law is known: regression on clean forces gives back the rest."""
    law = LAW_PLUGINS.get(name)
    p = {n: LAWS[name][n] for n in law.parameters}
    force = np.asarray(law.force(GRID, p))
    for count in range(len(p) + 1):
        for known in itertools.combinations(p, count):
            form = law.linear_form(GRID, {n: p[n] for n in known})
            found = form.decode(np.linalg.lstsq(form.columns, force - form.offset, rcond=None)[0])
            assert set(found) == set(p) - set(known)
            for n, v in found.items():
                assert v == pytest.approx(p[n], rel=1e-7, abs=1e-9), (known, n)


@pytest.mark.parametrize("name", LAW_PLUGINS.names())
def test_start_has_the_frequency_and_the_rest_position(name):
    law = LAW_PLUGINS.get(name)
    p = law.start(6.3, 0.21, {})
    assert set(p) == set(law.parameters)
    osc = Oscillator(("viscous",), name)
    assert osc.equilibrium(p, 0.2) == pytest.approx(0.21, abs=1e-9)
    assert osc.natural_frequency(p, 0.2) == pytest.approx(6.3, rel=1e-9)


@pytest.mark.parametrize("gravity", [1.0, -243.0, 30.0])
def test_start_with_known_gravity(gravity):
    p = LAW_PLUGINS.get("horizontal_pendulum").start(20.0, 0.5, {"gravity": gravity})
    osc = Oscillator(("viscous",), "horizontal_pendulum")
    assert p["gravity"] == gravity
    assert osc.equilibrium(p, 0.5) == pytest.approx(0.5, abs=1e-9)
    assert osc.natural_frequency(p, 0.5) == pytest.approx(20.0, rel=1e-9)


@pytest.mark.parametrize("name", LAW_PLUGINS.names())
def test_start_keeps_what_is_known(name):
    law = LAW_PLUGINS.get(name)
    known = {
        law.parameters[0]: LAWS[name][law.parameters[0]],
        law.parameters[-1]: LAWS[name][law.parameters[-1]],
    }
    assert {n: law.start(4.0, 0.1, known)[n] for n in known} == known


def test_equilibrium_of_the_paper():
    """kθ = cos θ for the paper's numbers, and ω_n = √(k + sin θ) there."""
    osc = Oscillator(("viscous",), "horizontal_pendulum")
    p = LAWS["horizontal_pendulum"]
    at = osc.equilibrium(p)
    assert 20 * at == pytest.approx(math.cos(at), abs=1e-10)
    assert osc.natural_frequency(p) == pytest.approx(math.sqrt(20 + math.sin(at)), rel=1e-12)


def test_no_equilibrium_is_an_error():
    p = {"stiffness": -1.0, "rest_angle": 0.0}
    with pytest.raises(ValueError, match="no stable equilibrium"):
        Oscillator(("viscous",), "linear").equilibrium(p)
