"""Damping terms and restoring laws: the contract of every plug-in, and its work by quadrature."""

import itertools
import math

import numpy as np
import pytest
from scipy.integrate import quad

from bayesdamp.physics.damping import GIVEN, TERMS, DampingTerm, median
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.physics.restoring import LAWS as LAW_PLUGINS, RestoringLaw
from tests.physics.independent import LAWS, restoring

GRID = np.linspace(-0.6, 0.7, 57)


def known_of(term, rest=0.1, amplitude=0.3, frequency=1.3 / 0.3):
    """Return the values that a term's force needs; its own parameters are the medians of their priors."""
    given = {"rest": rest, "reference_velocity": amplitude * frequency, "reference_amplitude": amplitude}
    return given | {p.name: median(p.prior(amplitude, frequency)) for p in term.inferred}


@pytest.mark.parametrize("name", TERMS.names())
def test_the_force_of_a_term_is_odd_in_the_velocity_and_dissipates(name):
    term = TERMS.get(name)
    assert isinstance(term, DampingTerm)
    assert term.name == name
    assert all((term.parameter, term.unit, term.words))
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
    """Control: with another ε it is not, if the term has a switch."""
    term, v = TERMS.get(name), np.linspace(-3, 3, 13)
    further = [known_of(term)[n] for n in term.further]
    force = term.force(np.full_like(v, 0.2), v, 0.1, *further)
    assert force.shape == v.shape
    own, other = ([term.kernel(0.2, float(x), width, *further) for x in v] for width in (0.1, 0.11))
    np.testing.assert_allclose(force, own, atol=1e-12)
    assert np.allclose(force, other, atol=1e-9) != term.switches


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


def test_a_kernel_for_single_numbers_also_works_on_arrays():
    x = np.linspace(-1, 1, 5)
    np.testing.assert_allclose(Branching().force(x, 3 * x, 0.1), np.where(np.abs(x) > 0.01, 3 * x, 0.0))
    np.testing.assert_allclose(Kinked().force(x, {"stiffness": 3.0}), np.where(x < 0, 3 * x, 6 * x))
    each = Kinked().force(x[:, None], {"stiffness": np.array([1.0, 2.0])})
    np.testing.assert_allclose(each, np.where(x < 0, x, 2 * x)[:, None] * [1.0, 2.0])


def work_by_quadrature(force, rest, amplitude, frequency, breaks=(0.0,)):
    """Return the energy dissipated in a harmonic cycle, by SciPy's quadrature between breaks (θ − rest)."""

    def power(phase: float, direction: float) -> float:
        speed = direction * amplitude * frequency * math.cos(phase)
        return force(rest + amplitude * math.sin(phase), speed, 1e-12) * speed / frequency

    ends = [-math.pi / 2, *sorted(math.asin(x / amplitude) for x in breaks), math.pi / 2]
    return sum(
        quad(power, low, high, args=(direction,), epsabs=1e-13, epsrel=1e-11, limit=200)[0]
        for direction in (1.0, -1.0)
        for low, high in itertools.pairwise(ends)
    )


@pytest.mark.parametrize("name", TERMS.names())
def test_the_work_and_the_equivalent_damping_ratio_are_those_of_the_force(name):
    """The ratio is the work over that of a viscous ratio of 1. Control: work that is wrong by 1 %."""
    term, amplitude, frequency = TERMS.get(name), 1.7, 0.6
    known = known_of(term, 0.2, amplitude, frequency)
    lost = work_by_quadrature(term.at(known), 0.2, amplitude, frequency)
    expected = lost / (2 * math.pi * frequency**2 * amplitude**2)
    assert term.ratio_per_unit(amplitude, frequency) == pytest.approx(expected, rel=1e-6)
    work = term.work(amplitude, frequency, {n: v for n, v in known.items() if n not in GIVEN})
    assert work == pytest.approx(lost, rel=1e-6)
    assert work != pytest.approx(1.01 * lost, rel=1e-6)


@pytest.mark.parametrize(
    ("name", "further"),
    [
        ("power", {"exponent": -0.3}),
        ("power", {"exponent": 3.3, "reference_velocity": 0.2}),
        ("stribeck", {"static_excess": 0.8, "stribeck_velocity": 0.02}),
        # Friction is zero on one side, on both sides, near rest, and nowhere.
        ("dry_position", {"friction_slope": 2.0, "friction_curvature": 0.5}),
        ("dry_position", {"friction_slope": 0.1, "friction_curvature": -3.0}),
        ("dry_position", {"friction_slope": -2.5, "friction_curvature": 1.4, "reference_amplitude": 0.3}),
        ("dry_position", {"friction_slope": 0.0, "friction_curvature": 0.0}),
    ],
)
def test_work_in_closed_form_is_that_of_the_force(name, further):
    """Also the general rule of all terms is right to 1e-3. Control: work that is wrong by 1e-4."""
    term, a, w = TERMS.get(name), 0.4, 3.0
    force = term.at({"rest": 0.0, "reference_velocity": a * w, "reference_amplitude": a, **further})
    scale = further.get("reference_amplitude", a)
    square = [further.get("friction_curvature", 0.0), further.get("friction_slope", 0.0), 1.0]
    zeros = [scale * u.real for u in np.roots(square) if u.imag == 0 and abs(scale * u.real) < a]
    lost = work_by_quadrature(force, 0.0, a, w, zeros)
    assert type(term).work is not DampingTerm.work
    assert term.work(a, w, further) == pytest.approx(lost, rel=1e-8)
    assert DampingTerm.work(term, a, w, further) == pytest.approx(lost, rel=1e-3)
    assert term.work(a, w, further) != pytest.approx(1.0001 * lost, rel=1e-8)


def uneven(name):
    """Return parameters of a law without 0 and 1, which could hide a wrong product or power."""
    return {**LAWS[name], **({"gravity": 3.0, "spring_angle": 0.07} if name == "horizontal_pendulum" else {})}


@pytest.mark.parametrize("name", LAW_PLUGINS.names())
def test_the_force_of_a_law_is_that_of_its_equation(name):
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
def test_the_linear_form_recovers_the_unknown_parameters(name):
    """By regression on exact forces, for every choice of known parameters."""
    law = LAW_PLUGINS.get(name)
    p = {n: uneven(name)[n] for n in law.parameters}
    force = np.asarray(law.force(GRID, p))
    for count in range(len(p) + 1):
        for known in itertools.combinations(p, count):
            form = law.linear_form(GRID, {n: p[n] for n in known})
            values = form.decode(np.linalg.lstsq(form.columns, force - form.offset, rcond=None)[0])
            assert values == pytest.approx({n: p[n] for n in p if n not in known}, rel=1e-7, abs=1e-9), known


@pytest.mark.parametrize("name", LAW_PLUGINS.names())
def test_the_start_of_a_search_has_the_frequency_the_rest_position_and_known_values(name):
    law = LAW_PLUGINS.get(name)
    p = law.start(6.3, 0.21, {})
    assert set(p) == set(law.parameters)
    known = {n: LAWS[name][n] for n in (law.parameters[0], law.parameters[-1])}
    assert law.start(4.0, 0.1, known).items() >= known.items()
    osc = Oscillator(("viscous",), name)
    assert osc.equilibrium(p, 0.2) == pytest.approx(0.21, abs=1e-9)
    assert osc.natural_frequency(p, 0.2) == pytest.approx(6.3, rel=1e-9)
