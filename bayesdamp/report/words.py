"""Translate the names of parameters, models, methods and units into words and symbols for a reader."""

from bayesdamp.physics.symbols import meaning_of, own_words, parameter_symbol
from bayesdamp.types import Symbol, candidate_parts

_SYMBOLS = {
    "natural_frequency": Symbol("ωₙ", r"$\omega_n$", "natural frequency (derived)"),
    "quality_factor": Symbol("Q", r"$Q$", "quality factor in the limit of small amplitudes"),
}
_WORDS = {
    "noise_sd": ("noise sd", "standard deviation of the noise"),
    "log_likelihood": ("log likelihood", "natural logarithm of the likelihood of the record"),
    "noise_time": ("noise time", "correlation time of the noise"),
    "noise_dof": ("noise dof", "degrees of freedom of the noise"),
    "damping_ratio": ("small-amplitude damping ratio", "damping ratio in the limit of small amplitudes"),
    "equivalent_ratio": ("equivalent damping ratio", "equivalent viscous damping ratio"),
    "log_decrement": ("logarithmic decrement", "logarithmic decrement"),
    "half_life": (
        "half-life",
        "time in which the amplitude falls from the reference amplitude to half of it",
    ),
    "energy_fraction": ("specific damping capacity", "fraction of the energy that is lost in a cycle"),
    "energy_lost": ("energy lost in a cycle", "energy lost in a cycle"),
    "viscous_coefficient": ("viscous coefficient", "inertia times 2ζ"),
    "coulomb_torque": ("friction", "inertia times μc"),
    "quadratic_coefficient": ("quadratic coefficient", "inertia times μq"),
}
"""Words for parameters of the noise and derived quantities that have no symbol: by name, how the parameter is written,
and what it means."""


def symbol(parameter: str) -> Symbol:
    """Return how a parameter is written in text and in figures, and what it means.

    It is written as its symbol. If it has none, the words in `_WORDS` are used; if these are missing too, its name.
    """
    named = parameter_symbol(parameter) or _SYMBOLS.get(parameter)
    text, meaning = _WORDS.get(parameter) or (parameter, meaning_of(parameter))
    return named or Symbol(text, text, meaning)


def axis(parameter: str, units: str) -> str:
    """Return a figure's axis label: the symbol of a parameter, and its unit `units` if this is not empty."""
    label = symbol(parameter).math
    return f"{label} / {divisor(unit(units))}" if units else label


def divisor(unit: str) -> str:
    """Return a unit as it is written after a slash, as in "x / (m/s)": in brackets if it contains a slash itself."""
    return f"({unit})" if "/" in unit else unit


_PROPER = {"coulomb": "Coulomb", "duffing": "Duffing"}


def model(name: str) -> str:
    """Return the name of a model in words.

    For `viscous+coulomb` this is "viscous + Coulomb". For `coulomb@linear`, a damping term and a restoring law, it is
    "Coulomb (linear)".
    """
    damping, restoring = candidate_parts(name)
    terms = " + ".join(own_words(term) or law(term) for term in damping.split("+"))
    return f"{terms} ({law(restoring)})" if restoring else terms


def law(name: str) -> str:
    """Return the name of a restoring law or a damping term in words: spaces for "_", and a capital for proper names."""
    return _PROPER.get(name, name.replace("_", " "))


_METHODS = {
    "nuts": "NUTS", "laplace": "Laplace", "pinn": "PINN", "rnn": "RNN", "sindy": "SINDy",
    "weak_sindy": "weak SINDy", "importance": "importance sampling", "bridge": "bridge sampling",
    "combined": "adopted evidence", "smc": "sequential Monte Carlo", "nested": "nested sampling",
    "neural_ode": "neural ODE", "koopman": "Koopman", "student_t": "Student t",
}  # fmt: skip


def method(name: str) -> str:
    """Return the name of an estimator, a sampler, an evidence method or a noise model in words."""
    return _METHODS.get(name, name.replace("_", " "))


def stage(name: str) -> str:
    """Return the name of an estimator's stage in words.

    "initial" becomes "own estimate", and "refined" becomes "trajectory fit"; other names are not changed.
    """
    return {"initial": "own estimate", "refined": "trajectory fit"}.get(name, name)


def unit(text: str) -> str:
    """Return a unit with its exponents 2 and 3 as superscripts, such as s² for `s^2`."""
    return text.replace("^2", "²").replace("^3", "³").replace("s2", "s²").replace("**2", "²")
