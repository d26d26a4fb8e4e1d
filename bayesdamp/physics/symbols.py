"""How parameters of an oscillator are written."""

from __future__ import annotations

from bayesdamp.physics.damping import TERMS
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
