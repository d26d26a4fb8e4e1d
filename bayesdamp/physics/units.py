"""Units of parameters, for an angle in rad or a displacement in another unit."""

from __future__ import annotations

from bayesdamp.physics.damping import TERMS
from bayesdamp.physics.restoring import LAWS
from bayesdamp.units import quantity_unit


def parameter_unit(name: str, restoring: str, unit: str = "rad", quantity: str = "angle") -> str:
    """Unit of a parameter of an oscillator with this restoring law, recorded as this quantity.

    unit: the base that is computed in.
    """
    if name == "noise_sd":
        return quantity_unit(unit, quantity)
    fixed = {"theta0": "rad", "omega0": "rad/s", "epsilon": "rad/s", "noise_time": "s", "noise_dof": "1"}
    fixed |= {"rest": "rad", "reference_amplitude": "rad", "reference_velocity": "rad/s"}
    if name == "natural_frequency":
        return "rad/s"
    for term in map(TERMS.get, TERMS.present()):
        fixed[term.parameter] = term.unit
        fixed |= {p.name: p.unit for p in term.inferred}
    found = fixed.get(name) or LAWS.get(restoring).unit(name)
    return found.replace("rad", unit)
