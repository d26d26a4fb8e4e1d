"""Look up the symbol, description and unit of an oscillator's parameter."""

from bayesdamp.physics.damping import TERMS, words_of
from bayesdamp.physics.restoring import LAWS
from bayesdamp.types import Symbol, quantity_unit

# Symbols of parameters that belong to no damping term or restoring law.
_STATE = {
    "epsilon": Symbol("ε", r"$\epsilon$", "friction regularisation velocity"),
    "theta0": Symbol("θ₀", r"$\theta_0$", "angle at the start"),
    "omega0": Symbol("θ̇₀", r"$\dot\theta_0$", "velocity at the start"),
}


def parameter_symbol(name: str) -> Symbol | None:
    """Return the symbol of a parameter by its name, or None if it has no symbol or the name is unknown.

    Known names are those of the parameters of all damping terms and restoring laws, and epsilon, theta0 and omega0.
    """
    known = dict(_STATE)
    for law in map(LAWS.get, LAWS.present()):
        known |= {n: s for n, s in law.symbols.items() if n in law.parameters}
    for term in map(TERMS.get, TERMS.present()):
        known |= {p.name: p.symbol for p in term.inferred if p.symbol is not None}
        known |= {} if term.symbol is None else {term.parameter: term.symbol}
    return known.get(name)


def own_words(term: str) -> str:
    """Return the name of a damping term that a user added, as it is written in a sentence.

    term: name of the term in the registry. Return "" for a term that ships with bayesdamp, or an unknown one.
    """
    return words_of(term) if term in TERMS.added() else ""


def meaning_of(parameter: str) -> str:
    """Return a description of a parameter of a damping term that a user added, such as "coefficient of eddy damping".

    A parameter other than the coefficient gives "parameter of eddy damping". For a parameter of no such term return
    "parameter".
    """
    for term in map(TERMS.get, TERMS.added()):
        if parameter == term.parameter:
            return f"coefficient of {words_of(term.name)} damping"
        if parameter in term.further:
            return f"parameter of {words_of(term.name)} damping"
    return "parameter"


def parameter_unit(name: str, restoring: str, unit: str = "rad", quantity: str = "angle") -> str:
    """Return the unit of a parameter of an oscillator or its noise, by name.

    For an unknown name, return the unit of the displacement.

    Parameters
    ----------
    name
        Name of the parameter.
    restoring
        Name of the restoring law.
    unit
        Unit of the displacement, such as rad, mm or V, which replaces rad in the result.
    quantity
        The recorded quantity: "angle", "velocity" or "acceleration". Only the unit of `noise_sd` depends on it.
    """
    if name == "noise_sd":
        return quantity_unit(unit, quantity)
    if name == "natural_frequency":
        return "rad/s"
    units = {"theta0": "rad", "omega0": "rad/s", "epsilon": "rad/s", "noise_time": "s", "noise_dof": "1"}
    units |= {"rest": "rad", "reference_amplitude": "rad", "reference_velocity": "rad/s"}
    for term in map(TERMS.get, TERMS.present()):
        units[term.parameter] = term.unit
        units |= {p.name: p.unit for p in term.inferred}
    return (units.get(name) or LAWS.get(restoring).unit(name)).replace("rad", unit)
