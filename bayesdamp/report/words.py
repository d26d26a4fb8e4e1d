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
"""Parameters of the noise and derived quantities without a symbol: the words for each, and its meaning."""


def symbol(parameter: str) -> Symbol:
    """Return what stands for a parameter in text and in figures, and the meaning of the parameter.

    It is the parameter's symbol; if it has none, its words in `_WORDS`; if there are none, its name.
    """
    named = parameter_symbol(parameter) or _SYMBOLS.get(parameter)
    text, meaning = _WORDS.get(parameter) or (parameter, meaning_of(parameter))
    return named or Symbol(text, text, meaning)


def axis(parameter: str, units: str) -> str:
    """Return a figure's axis label: the symbol of a parameter, and its unit `units` if this is not empty."""
    label = symbol(parameter).math
    return f"{label} / {divisor(unit(units))}" if units else label


def divisor(unit: str) -> str:
    """Return a unit as it is written after a slash: in brackets if it contains a slash itself."""
    return f"({unit})" if "/" in unit else unit


_PROPER = {"coulomb": "Coulomb", "duffing": "Duffing"}


def model(name: str) -> str:
    """Return a model in words: "viscous + Coulomb" for `viscous+coulomb`, "Coulomb (linear)" for `coulomb@linear`."""
    damping, restoring = candidate_parts(name)
    terms = " + ".join(own_words(term) or law(term) for term in damping.split("+"))
    return f"{terms} ({law(restoring)})" if restoring else terms


def law(name: str) -> str:
    """Return a restoring law or a damping term in words: with spaces for "_", and a capital for proper names."""
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
    """Return a unit with raised exponents: s² for `s^2`."""
    return text.replace("^2", "²").replace("^3", "³").replace("s2", "s²").replace("**2", "²")
