"""Numbers, units and names as a reader wants them."""

from __future__ import annotations

import math
from collections.abc import Iterable

from bayesdamp.physics.symbols import meaning_of, own_words, parameter_symbol
from bayesdamp.types import Symbol, candidate_parts

NONE = "–"


_SYMBOLS = {
    "noise_sd": Symbol("noise sd", "noise sd", "standard deviation of the noise"),
    "noise_time": Symbol("noise time", "noise time", "correlation time of the noise"),
    "noise_dof": Symbol("noise dof", "noise dof", "degrees of freedom of the noise"),
    "natural_frequency": Symbol("ωₙ", r"$\omega_n$", "natural frequency (derived)"),
    "damping_ratio": Symbol("damping ratio at rest", "damping ratio at rest", "linear damping ratio at rest"),
    "quality_factor": Symbol("Q", r"$Q$", "quality factor at rest"),
    "equivalent_ratio": Symbol(
        "equivalent damping ratio", "equivalent damping ratio", "equivalent viscous damping ratio"
    ),
    "log_decrement": Symbol("logarithmic decrement", "logarithmic decrement", "logarithmic decrement"),
    "half_life": Symbol("half-life", "half-life", "time in which the amplitude halves"),
    "energy_fraction": Symbol(
        "specific damping capacity", "specific damping capacity", "share of the energy lost in a cycle"
    ),
    "energy_lost": Symbol("energy lost in a cycle", "energy lost in a cycle", "energy lost in a cycle"),
    "viscous_coefficient": Symbol("viscous coefficient", "viscous coefficient", "inertia times 2ζ"),
    "coulomb_torque": Symbol("friction", "friction", "inertia times μc"),
    "quadratic_coefficient": Symbol("quadratic coefficient", "quadratic coefficient", "inertia times μq"),
}
"""Of the noise, and of what follows from parameters."""


def symbol(parameter: str) -> Symbol:
    """How a parameter is written; one without a symbol keeps its name."""
    named = parameter_symbol(parameter) or _SYMBOLS.get(parameter)
    return named or Symbol(parameter, parameter, meaning_of(parameter))


def known(parameter: str) -> bool:
    """Whether it is one of the parameters and derived quantities that ship."""
    return parameter in _SYMBOLS or parameter_symbol(parameter) is not None


def axis(parameter: str, units: str) -> str:
    """A figure's axis label: the symbol over its unit."""
    shown = unit(units)
    if not shown:
        return symbol(parameter).math
    return f"{symbol(parameter).math} / {f'({shown})' if '/' in shown else shown}"


_PROPER = {"coulomb": "Coulomb", "duffing": "Duffing"}


def model(name: str) -> str:
    """A candidate in words: `viscous+coulomb` is viscous + Coulomb, `coulomb@linear` Coulomb (linear)."""
    damping, restoring = candidate_parts(name)
    said = " + ".join(own_words(t) or _PROPER.get(t, t.replace("_", " ")) for t in damping.split("+"))
    return f"{said} ({law(restoring)})" if restoring else said


def law(name: str) -> str:
    """A restoring law in words."""
    return _PROPER.get(name, name.replace("_", " "))


def method(name: str) -> str:
    """A method in words."""
    special = {
        "nuts": "NUTS",
        "kalman": "Kalman filter",
        "laplace": "Laplace",
        "pinn": "PINN",
        "rnn": "RNN",
        "sindy": "SINDy",
        "weak_sindy": "weak SINDy",
    }
    special |= {"importance": "importance sampling", "bridge": "bridge sampling"}
    special |= {"combined": "adopted evidence", "smc": "sequential Monte Carlo", "nested": "nested sampling"}
    special |= {"neural_ode": "neural ODE", "koopman": "Koopman", "student_t": "Student t"}
    return special.get(name, name.replace("_", " "))


def stage(name: str) -> str:
    """A stage of an estimator in words."""
    return {"initial": "own estimate", "refined": "trajectory fit"}.get(name, name)


def unit(text: str) -> str:
    """A unit with its powers raised."""
    return text.replace("^2", "²").replace("^3", "³").replace("s2", "s²").replace("**2", "²")


_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def number(value: float | None, digits: int = 4) -> str:
    """A number to so many significant digits; a dash where there is none."""
    if value is None or math.isnan(value):
        return NONE
    if math.isinf(value):
        return "∞" if value > 0 else "−∞"
    if value == 0:
        return "0"
    power = _power(value, digits)
    if -4 <= power < 6:
        return _signed(f"{value:.{max(0, digits - 1 - power)}f}")
    return _scientific(value, power, digits - 1)


def rms(value: float, unit: str) -> str:
    """A residual with its unit."""
    return f"{number(value, 3)} {unit}"


def short(error: float) -> str:
    """An error where there is little room: two digits, below a ten-thousandth one and a power."""
    if not math.isfinite(error) or error == 0 or abs(error) >= 1e-4:
        return number(error, 2)
    return f"{error:.0e}".replace("e-0", "e-").replace("-", "−")


def fixed(value: float, places: int) -> str:
    """A number to so many decimals."""
    return _signed(f"{round(value, places) + 0.0:.{places}f}") if math.isfinite(value) else number(value)


def given(value: float) -> str:
    """A number that somebody chose: without digits that were not given."""
    return _signed(f"{value:.6g}") if 1e-4 <= abs(value) < 1e6 or value == 0 else number(value, 3)


NEGLIGIBLE = 1e-7
"""Share of a value below which its error is that of a record without noise, and not written."""


def with_error(value: float | None, error: float | None) -> str:
    """value ± error, to two significant digits of the error; the value alone where there is none, or next to none."""
    if value is None or not math.isfinite(value) or error is None or not math.isfinite(error) or error <= 0:
        return number(value)
    if error < NEGLIGIBLE * abs(value):
        return number(value, 7)
    decimals = 1 - _power(error, 2)
    top = max(_power(value, 4), _power(error, 2)) if value else _power(error, 2)
    if -4 <= top < 6 and decimals <= 8:
        places = max(0, decimals)
        return f"{_signed(f'{value:.{places}f}')} ± {error:.{places}f}"
    places = max(0, top + decimals)
    tens = 10.0**top
    body = f"({value / tens:.{places}f} ± {error / tens:.{places}f})"
    return f"{_signed(body)} × 10{str(top).translate(_RAISED)}"


def nats(value: float | None, error: float = math.nan) -> str:
    """A logarithm of probability: never finer than a hundredth, for nothing hangs on that."""
    if value is None or not math.isfinite(value):
        return number(value)
    places = 2 if abs(value) < 100 or error < 0.5 else 1 if abs(value) < 1000 else 0
    shown = _signed(f"{value:.{places}f}")
    if not math.isfinite(error):
        return shown
    return f"{shown} ± {error:.2f}" if error >= 0.005 else f"{shown} ± < 0.01"


def interval(low: float | None, high: float | None) -> str:
    """[low, high] to two significant digits of the width."""
    if low is None or high is None or not (math.isfinite(low) and math.isfinite(high)):
        return NONE
    width = high - low
    if width <= 0:
        return f"[{number(low)}, {number(high)}]"
    places = max(0, 1 - _power(width / 4, 2))
    if places > 8 or max(abs(low), abs(high)) >= 1e6:
        return f"[{number(low, 4)}, {number(high, 4)}]"
    return f"[{_signed(f'{low:.{places}f}')}, {_signed(f'{high:.{places}f}')}]"


def spread(low: float, high: float) -> str:
    """low to high, to two significant digits of the difference, within three to five of the larger."""
    if low == high:
        return number(low)
    digits = _power(max(abs(low), abs(high)), 3) - _power(high - low, 2) + 2
    places = min(5, max(3, digits))
    return f"{number(low, places)} to {number(high, places)}"


def probability(value: float | None) -> str:
    """A probability: three decimals, and a bound rather than 0 or 1."""
    if value is None or math.isnan(value):
        return NONE
    if value > 0.9995:
        return ">\u00a00.999"
    if value < 0.0005:
        return "<\u00a00.001"
    return f"{value:.3f}"


def duration(seconds: float | None) -> str:
    """Seconds as a reader says them."""
    if seconds is None or not math.isfinite(seconds):
        return NONE
    if seconds < 0.0995:
        return f"{1000 * seconds:.0f} ms"
    if seconds < 60:
        return f"{seconds:.1f} s" if seconds < 9.95 else f"{seconds:.0f} s"
    whole = round(seconds)
    if whole < 3600:
        return f"{whole // 60} min {whole % 60:02d} s"
    return f"{whole // 3600} h {whole % 3600 // 60:02d} min"


def listing(items: Iterable[str], last: str = "and") -> str:
    """a, b and c."""
    words = list(items)
    return f"{', '.join(words[:-1])} {last} {words[-1]}" if len(words) > 1 else "".join(words)


def _power(value: float, digits: int) -> int:
    """Decimal exponent of a number once it is rounded to so many digits."""
    return int(f"{value:.{digits - 1}e}".split("e")[1])


def _signed(text: str) -> str:
    return text.replace("-", "−")


def _scientific(value: float, power: int, places: int) -> str:
    return f"{_signed(f'{value / 10.0**power:.{places}f}')} × 10{str(power).translate(_RAISED)}"
