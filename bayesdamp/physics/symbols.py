"""Give the symbols, words and units of an oscillator's parameters."""

from __future__ import annotations

from bayesdamp.physics.damping import TERMS, words_of
from bayesdamp.physics.restoring import LAWS
from bayesdamp.types import Symbol
from bayesdamp.units import quantity_unit

_STATE = {
    "epsilon": Symbol("ε", r"$\epsilon$", "friction regularisation velocity"),
    "theta0": Symbol("θ₀", r"$\theta_0$", "angle at the start"),
    "omega0": Symbol("θ̇₀", r"$\dot\theta_0$", "velocity at the start"),
}


def parameter_symbol(name: str) -> Symbol | None:
    """Return the symbol of a parameter of a damping term, a restoring law or the start; None where it has none."""
    known = dict(_STATE)
    for law in map(LAWS.get, LAWS.present()):
        known |= {n: s for n, s in law.symbols.items() if n in law.parameters}
    for term in map(TERMS.get, TERMS.present()):
        known |= {p.name: p.symbol for p in term.inferred if p.symbol is not None}
        known |= {} if term.symbol is None else {term.parameter: term.symbol}
    return known.get(name)


def own_words(term: str) -> str:
    """Return the words for a user's own damping term in sentences; empty for one that ships or is not known here."""
    return words_of(term) if term in TERMS.added() else ""


def meaning_of(parameter: str) -> str:
    """Return what a parameter without a symbol is, in words."""
    for term in map(TERMS.get, TERMS.added()):
        if parameter == term.parameter:
            return f"coefficient of {words_of(term.name)} damping"
        if parameter in term.further:
            return f"parameter of {words_of(term.name)} damping"
    return "parameter"


def parameter_unit(name: str, restoring: str, unit: str = "rad", quantity: str = "angle") -> str:
    """Return the unit of a parameter of an oscillator.

    Parameters
    ----------
    name
        The parameter.
    restoring
        The restoring law.
    unit
        Base unit of the displacement.
    quantity
        The recorded quantity.
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
    own = units.get(name) or LAWS.get(restoring).unit(name)
    return own.replace("rad", unit)
