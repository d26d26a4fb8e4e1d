"""Damping terms and restoring laws: the contract of every plug-in, and closed forms."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from scipy.integrate import quad

from bayesdamp.physics.damping import GIVEN, TERMS, DampingTerm, median, parse_model
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.physics.restoring import LAWS as LAW_PLUGINS, RestoringLaw
from bayesdamp.types import InputError
from tests.physics.independent import LAWS, restoring

GRID = np.linspace(-0.6, 0.7, 57)


def known_of(term, rest=0.1, amplitude=0.3, frequency=1.3 / 0.3):
    """What a term's force has to know, its own parameters at the medians of their priors."""
    given = {"rest": rest, "reference_velocity": amplitude * frequency, "reference_amplitude": amplitude}
    return given | {p.name: median(p.prior(amplitude, frequency)) for p in term.inferred}


@pytest.mark.parametrize("name", TERMS.names())
def test_contract_of_a_term(name):
    """Odd in the velocity about rest, and it takes energy out, wherever it is."""
    term = TERMS.get(name)
    assert isinstance(term, DampingTerm)
    assert term.name == name
    assert term.parameter
    assert term.unit
    assert term.words
    assert set(term.given) <= set(GIVEN)
    assert {p.name for p in term.inferred} >= {n for n, _ in term.reduces}
    force = term.at(known_of(term))
    for epsilon in (1e-3, 0.1):
        for x in (-0.2, 0.1, 0.35):
            for v in np.linspace(0.0, 3, 13):
                assert force(x, v, epsilon) * v >= 0
                assert force(x, -v, epsilon) == pytest.approx(-force(x, v, epsilon), abs=5e-13)


@pytest.mark.parametrize("name", TERMS.names())
def test_the_force_on_arrays_is_the_kernel(name):
    """Where a kernel is run on arrays it is by names of functions and their order."""
    term, v = TERMS.get(name), np.linspace(-3, 3, 13)
    further = [known_of(term)[n] for n in term.further]
    force = term.force(np.full_like(v, 0.2), v, 0.1, *further)
    assert force.shape == v.shape
    np.testing.assert_allclose(force, [term.kernel(0.2, float(one), 0.1, *further) for one in v], atol=1e-12)
    other = [term.kernel(0.2, float(one), 0.11, *further) for one in v]
    assert np.allclose(force, other, atol=1e-9) != term.switches  # control


class Branching(DampingTerm):
    """F = c θ̇ outside a dead zone."""

    name, parameter, unit = "branching", "c_branching", "1/s"

    @staticmethod
    def kernel(x: float, v: float, epsilon: float) -> float:
        """0 within 0.01."""
        return v if abs(x) > 0.01 else 0.0


class Kinked(type(LAW_PLUGINS.get("linear"))):
    """F = k θ, twice as stiff above 0."""

    parameters = ("stiffness",)

    @staticmethod
    def kernel(x, p):
        """With an `if`."""
        return p[0] * x if x < 0 else 2 * p[0] * x


def test_a_kernel_of_numbers_alone_is_called_number_by_number():
    x = np.linspace(-1, 1, 5)
    np.testing.assert_allclose(Branching().force(x, 3 * x, 0.1), np.where(np.abs(x) > 0.01, 3 * x, 0.0))
    np.testing.assert_allclose(Kinked().force(x, {"stiffness": 3.0}), np.where(x < 0, 3 * x, 6 * x))
    each = Kinked().force(x[:, None], {"stiffness": np.array([1.0, 2.0])})
    np.testing.assert_allclose(each, np.where(x < 0, x, 2 * x)[:, None] * [1.0, 2.0])


@pytest.mark.parametrize("name", TERMS.names())
def test_equivalent_ratio(name):
    """Energy lost in a cycle of a harmonic motion, by SciPy's quadrature, over that of a viscous ratio of 1."""
    term, amplitude, frequency = TERMS.get(name), 1.7, 0.6
    known = known_of(term, 0.2, amplitude, frequency)
    force = term.at(known)

    def power(t: float) -> float:
        v = -amplitude * frequency * math.sin(frequency * t)
        return force(0.2 + amplitude * math.cos(frequency * t), v, 1e-12) * v

    quarter = math.pi / 2 / frequency
    ends = itertools.pairwise(quarter * np.arange(5))
    lost = sum(quad(power, *pair, epsabs=1e-12, epsrel=1e-10)[0] for pair in ends)
    expected = lost / (2 * math.pi * frequency**2 * amplitude**2)
    assert term.ratio_per_unit(amplitude, frequency) == pytest.approx(expected, rel=1e-6)
    by_rule = term.work(amplitude, frequency, {n: v for n, v in known.items() if n not in GIVEN})
    assert by_rule == pytest.approx(lost, rel=1e-6)
    assert by_rule != pytest.approx(1.01 * lost, rel=1e-6)  # control


@pytest.mark.parametrize(
    ("name", "further"),
    [
        ("power", {"exponent": -0.3}),
        ("power", {"exponent": 3.3, "reference_velocity": 0.2}),
        ("stribeck", {"static_excess": 0.8, "stribeck_velocity": 0.02}),
        # Without friction on one side, on both, within, and nowhere.
        ("dry_position", {"friction_slope": 2.0, "friction_curvature": 0.5}),
        ("dry_position", {"friction_slope": 0.1, "friction_curvature": -3.0}),
        ("dry_position", {"friction_slope": -2.5, "friction_curvature": 1.4, "reference_amplitude": 0.3}),
        ("dry_position", {"friction_slope": 0.0, "friction_curvature": 0.0}),
    ],
)
def test_a_closed_form_is_the_work_of_the_kernel(name, further):
    """By SciPy's quadrature over the way there and back, whose breaks are where friction begins and ends."""
    term, a, w = TERMS.get(name), 0.4, 3.0
    force = term.at({"rest": 0.0, "reference_velocity": a * w, "reference_amplitude": a, **further})
    scale = further.get("reference_amplitude", a)
    square = [further.get("friction_curvature", 0.0), further.get("friction_slope", 0.0), 1.0]
    breaks = [scale * u.real for u in np.roots(square) if u.imag == 0 and abs(scale * u.real) < a]
    angles = sorted(math.asin(x / a) for x in breaks)

    def power(phase: float, way: float) -> float:
        x, v = a * math.sin(phase), way * a * w * math.cos(phase)
        return force(x, v, 1e-12) * way * a * math.cos(phase)

    ends = [-math.pi / 2, *angles, math.pi / 2]
    lost = sum(
        quad(power, low, high, args=(way,), epsabs=1e-13, epsrel=1e-11, limit=200)[0]
        for way in (1.0, -1.0)
        for low, high in itertools.pairwise(ends)
    )
    assert term.work(a, w, further) == pytest.approx(lost, rel=1e-8)
    assert type(term).work is not DampingTerm.work
    by_rule = DampingTerm.work(term, a, w, further)  # across breaks too
    assert by_rule == pytest.approx(lost, rel=1e-3)
    assert term.work(a, w, further) != pytest.approx(1.0001 * lost, rel=1e-8)  # control


def test_names_of_models():
    assert parse_model("viscous + coulomb") == ("viscous", "coulomb")
    for wrong in ("viscous+viscous", "", "viscous+"):
        with pytest.raises(InputError, match="sum of different terms"):
            parse_model(wrong)
    with pytest.raises(InputError, match="did you mean 'viscous'"):
        parse_model("viscos")


def uneven(name):
    """A law's parameters, none of which is 0 or 1: the paper's hide a wrong product or power."""
    return {**LAWS[name], **({"gravity": 3.0, "spring_angle": 0.07} if name == "horizontal_pendulum" else {})}


@pytest.mark.parametrize("name", LAW_PLUGINS.names())
def test_contract_of_a_law(name):
    law, p = LAW_PLUGINS.get(name), uneven(name)
    assert isinstance(law, RestoringLaw)
    assert law.name == name
    assert set(law.parameters) <= set(p)
    assert all(law.unit(n) for n in law.parameters)
    expected = [restoring(name, p)(float(x)) for x in GRID]
    np.testing.assert_allclose(np.asarray(law.force(GRID, p)), expected, atol=1e-13)
    values = np.array([p[n] for n in law.parameters])
    np.testing.assert_allclose([law.kernel(float(x), values) for x in GRID], expected, atol=1e-13)


@pytest.mark.parametrize("name", LAW_PLUGINS.names())
def test_linear_form_finds_what_is_free(name):
    """Whatever part of the law is known: regression on clean forces gives back the rest."""
    law = LAW_PLUGINS.get(name)
    p = {n: uneven(name)[n] for n in law.parameters}
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
    """And what is known as it is."""
    law = LAW_PLUGINS.get(name)
    p = law.start(6.3, 0.21, {})
    assert set(p) == set(law.parameters)
    known = {n: LAWS[name][n] for n in (law.parameters[0], law.parameters[-1])}
    assert law.start(4.0, 0.1, known).items() >= known.items()
    osc = Oscillator(("viscous",), name)
    assert osc.equilibrium(p, 0.2) == pytest.approx(0.21, abs=1e-9)
    assert osc.natural_frequency(p, 0.2) == pytest.approx(6.3, rel=1e-9)


def test_no_equilibrium_is_an_error():
    p = {"stiffness": -1.0, "rest_angle": 0.0}
    with pytest.raises(ValueError, match="no stable equilibrium"):
        Oscillator(("viscous",), "linear").equilibrium(p)
