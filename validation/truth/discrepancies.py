"""Define ten small discrepancies between a record and every law that is compared.

Each function draws the random details of a discrepancy for an oscillator. It returns either a change of the equation of
motion (`Discrepancy`), or a sensor (`Observe`) that reads the motion wrongly.

Notation: A is the amplitude at the release, ω the frequency of small motions, V = ωA the peak velocity.
"""

import math
from collections.abc import Callable

import numpy as np
from scipy.interpolate import CubicSpline

from validation.truth.drawing import MIDDLE, Draw, log_uniform, middle_ratio
from validation.truth.motion import Motion
from validation.truth.oscillator import Discrepancy
from validation.truth.ratio import harmonic_ratio

CUBIC_SENSOR = 0.005
"""Relative error of the nonlinear sensor's reading when the displacement equals the first amplitude."""
DRIFT = 0.05
"""Relative change of all damping over the record, in the discrepancy `drift`."""
POWER = 1.7
"""Exponent of the velocity in the additional damping force of the discrepancy `power`."""
SHARE = (0.15, 0.25)
"""Range of the fraction of the energy loss that the additional damping force causes (|v|^1.7 or x²v, with displacement
x and velocity v), at 0.75 times the first amplitude."""
STRIBECK_EXCESS, STRIBECK_SPEED = 0.5, 0.3
"""Additional friction at rest, relative to the Coulomb friction; and velocity over which it decreases (Stribeck
velocity), relative to the first peak velocity."""
FRICTION_BY_ANGLE = 0.1
"""Largest relative change of the Coulomb friction with the angle, in the discrepancy `angle_friction`."""
SECOND_MODE = 0.01
"""Amplitude of the second mode, relative to the amplitude of the oscillator at the release."""
STIFFENING = 0.01
"""Additional restoring force when the displacement equals the first amplitude, relative to the force of the linear
spring."""
LAG = 0.1
"""Time constant of the slow sensor, in units of 1/ω, where ω is the angular frequency of small motions."""
JITTER, JITTER_CYCLES = 0.03, 2.0
"""Standard deviation of the random factor on the damping, and time between its independent values, in cycles."""
COULOMB = ("stribeck", "angle_friction")
"""Discrepancies that require Coulomb friction in the damping sum of the oscillator, because they change it."""
TAKING = ("power", "position_dependent")
"""Discrepancies that add a damping term, which causes part of the energy loss."""

Observe = Callable[[Motion, np.ndarray], np.ndarray]
"""A sensor: a function of a motion and of times (n,) in s since the release; it returns the displacements (n,) in rad
that the sensor reads."""


def cubic_sensor(rng: np.random.Generator, draw: Draw) -> Observe:
    """Return a sensor that reads x (1 ± 0.005 (x/A)²) at the displacement x, with a random sign.

    A is the first amplitude of the motion.
    """
    bend = CUBIC_SENSOR * rng.choice([-1.0, 1.0]) / draw.amplitude**2

    def observe(motion: Motion, times: np.ndarray) -> np.ndarray:
        x = motion.displacements(times)
        return x + bend * x**3

    return observe


def drift(rng: np.random.Generator, draw: Draw) -> Discrepancy:
    """Return a factor on all damping that increases or decreases by 5 % over the record, linearly in time."""
    rate = DRIFT * float(rng.choice([-1.0, 1.0])) / draw.duration
    middle = draw.begin + 0.5 * draw.duration
    return Discrepancy(scale=lambda t: 1 + rate * (t - middle))


def power(rng: np.random.Generator, draw: Draw) -> Discrepancy:
    """Return an additional damping force c |v|^1.7 sign v, which causes 15 to 25 % of the energy loss.

    v is the velocity. The fraction of the energy loss applies at 0.75 times the first amplitude.
    """
    c = _extra(draw, lambda x, v: math.copysign(abs(v) ** POWER, v))
    return Discrepancy("power_1.7", lambda x, v, turn: c * math.copysign(abs(v) ** POWER, v))


def stribeck(
    rng: np.random.Generator, draw: Draw, excess: float = STRIBECK_EXCESS, speed: float = STRIBECK_SPEED
) -> Discrepancy:
    """Return an additional friction at low velocities v: e μ exp(−(v/v_s)²), where μ is the Coulomb friction.

    excess: the factor e. speed: the Stribeck velocity v_s, relative to the first peak velocity.
    """
    more = excess * draw.oscillator.damping["coulomb"]
    slow = speed * draw.amplitude * draw.frequency
    return Discrepancy(
        "stribeck",
        lambda x, v, turn: more * turn * math.exp(-((v / slow) ** 2)),
        static_friction=lambda x: more,
    )


def position_dependent(rng: np.random.Generator, draw: Draw) -> Discrepancy:
    """Return an additional damping force c x² v, which causes 15 to 25 % of the energy loss.

    x and v are displacement and velocity. The fraction of the energy loss applies at 0.75 times the first amplitude.
    """
    c = _extra(draw, lambda x, v: x * x * v)
    return Discrepancy("x²v", lambda x, v, turn: c * x * x * v)


def angle_friction(rng: np.random.Generator, draw: Draw) -> Discrepancy:
    """Return a change of Coulomb friction μ with the angle x, as in an uneven bearing: 0.1 μ sin(2πx/λ + φ).

    λ is drawn from 0.7 to 3 times the first amplitude, and φ from 0 to 2π.
    """
    depth = FRICTION_BY_ANGLE * draw.oscillator.damping["coulomb"]
    turns, phase = 2 * np.pi / (log_uniform(rng, 0.7, 3.0) * draw.amplitude), float(rng.uniform(0, 2 * np.pi))
    return Discrepancy(
        "angle_friction", lambda x, v, turn: depth * turn * math.sin(turns * x + phase),
        static_friction=lambda x: depth * math.sin(turns * x + phase),
    )  # fmt: skip


def second_mode(rng: np.random.Generator, draw: Draw) -> Observe:
    """Return a sensor that adds a second decaying sinusoid, with 1 % of the amplitude and 1.5 to 5 times the frequency.

    Amplitude and frequency of the oscillator are those at the release. The damping ratio of the second sinusoid is that
    of the oscillator at 0.75 times this amplitude.
    """
    frequency, phase = float(rng.uniform(1.5, 5.0)) * draw.frequency, float(rng.uniform(0, 2 * np.pi))
    rate, size = middle_ratio(draw) * frequency, SECOND_MODE * draw.amplitude

    def observe(motion: Motion, times: np.ndarray) -> np.ndarray:
        return motion.displacements(times) + size * np.exp(-rate * times) * np.cos(frequency * times + phase)

    return observe


def missing_spring(rng: np.random.Generator, draw: Draw) -> Discrepancy:
    """Return an additional restoring force ± 0.01 ω² x (x/A)⁴, with a random sign, which no restoring law contains.

    x is the displacement, A the first amplitude, and ω the frequency of small motions.
    """
    c = STIFFENING * float(rng.choice([-1.0, 1.0])) * draw.frequency**2 / draw.amplitude**4
    return Discrepancy(spring=lambda x: c * x**5)


def sensor_lag(rng: np.random.Generator, draw: Draw) -> Observe:
    """Return a first-order (low-pass) sensor with time constant τ = 0.1/ω, where ω is the frequency of small motions.

    It reads amplitudes about 0.5 % too low, with a delay of about τ.

    Its reading is the integral over s of the angle at the time s before, weighted by exp(−s/τ)/τ. Gauss-Laguerre
    quadrature computes it, with an error of 1e-9 for a harmonic motion and its harmonics. Before the release the angle
    is constant.
    """
    delay = LAG / draw.frequency
    nodes, weights = np.polynomial.laguerre.laggauss(12)

    def observe(motion: Motion, times: np.ndarray) -> np.ndarray:
        past = [motion.at(np.maximum(times - delay * s, 0.0))[0] for s in nodes]
        return weights @ np.array(past) - motion.equilibrium

    return observe


def jitter(rng: np.random.Generator, draw: Draw) -> Discrepancy:
    """Return a random factor on all damping, with mean 1 and sd 3 %, that varies smoothly over about two cycles.

    It is a cubic spline through independent normal values every two cycles.
    """
    gap = JITTER_CYCLES * 2 * np.pi / draw.frequency
    count = int((draw.begin + draw.duration) / gap) + 6
    curve = CubicSpline(gap * np.arange(count), 1 + JITTER * rng.standard_normal(count))
    coefficients = curve.c.T.tolist()

    def scale(t: float) -> float:
        i = min(int(t / gap), count - 2)
        a, b, c, d = coefficients[i]
        u = t - i * gap
        return ((a * u + b) * u + c) * u + d

    return Discrepancy(scale=scale)


def _extra(draw: Draw, unit: Callable[[float, float], float]) -> float:
    """Return the coefficient with which an additional damping force causes a given fraction of the energy loss.

    The fraction is `draw.taken`, and applies at `MIDDLE` times the first amplitude. unit: the force with the
    coefficient 1, as a function of displacement (rad) and velocity (rad/s).
    """
    ratio = harmonic_ratio(unit, MIDDLE * draw.amplitude, draw.frequency)
    return middle_ratio(draw) * draw.taken / (1 - draw.taken) / ratio


KINDS: dict[str, Callable[[np.random.Generator, Draw], Discrepancy | Observe]] = {
    function.__name__: function
    for function in (
        cubic_sensor, drift, power, stribeck, position_dependent, angle_friction, second_mode, missing_spring,
        sensor_lag, jitter,
    )
}  # fmt: skip
"""The functions of this module that draw a discrepancy, by name, which is also the kind of the record."""
