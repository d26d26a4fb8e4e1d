"""How parameters of an oscillator are written."""

from __future__ import annotations

from bayesdamp.physics.damping import TERMS, words_of
from bayesdamp.physics.restoring import LAWS
from bayesdamp.types import Symbol

_STATE = {
    "epsilon": Symbol("ε", r"$\epsilon$", "friction regularisation velocity"),
    "theta0": Symbol("θ₀", r"$\theta_0$", "angle at the start"),
    "omega0": Symbol("θ̇₀", r"$\dot\theta_0$", "velocity at the start"),
}


def parameter_symbol(name: str) -> Symbol | None:
    """Of a parameter of any damping term or restoring law, or of the start; None where nothing is said of it."""
    known = dict(_STATE)
    for law in map(LAWS.get, LAWS.present()):
        known |= {n: s for n, s in law.symbols.items() if n in law.parameters}
    for term in map(TERMS.get, TERMS.present()):
        known |= {p.name: p.symbol for p in term.inferred if p.symbol is not None}
        known |= {} if term.symbol is None else {term.parameter: term.symbol}
    return known.get(name)


def own_words(term: str) -> str:
    """Return what a user's own damping term is called in sentences, "" for one that ships or is not known here."""
    return words_of(term) if term in TERMS.added() else ""


def meaning_of(parameter: str) -> str:
    """Return what a parameter without a symbol is, in words."""
    for term in map(TERMS.get, TERMS.added()):
        if parameter == term.parameter:
            return f"coefficient of {words_of(term.name)} damping"
        if parameter in term.further:
            return f"parameter of {words_of(term.name)} damping"
    return "parameter"
