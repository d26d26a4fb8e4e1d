"""A record of an oscillator by its compiled kernel: for terms whose force JAX does not have."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from bayesdamp.physics.oscillator import Oscillator

SHARPEST = 1e-3
"""Width, in peak velocities, within which a force turns over that is to jump."""


def scales_of(osc: Oscillator, p: Mapping[str, float]) -> dict[str, float]:
    """What terms may ask for that is no parameter, of the motion that starts with theta0 and omega0, where p has it
    not. Raises ValueError where there is no stable rest position."""
    near, start = float(p["theta0"]), float(p["omega0"])
    rest, frequency = osc.equilibrium(p, near), osc.natural_frequency(p, near)
    amplitude = float(np.hypot(near - rest, start / frequency))
    found = {"rest": rest, "reference_amplitude": amplitude, "reference_velocity": amplitude * frequency}
    return {n: float(p.get(n, v)) for n, v in found.items()}


def trajectory(osc: Oscillator, p: Mapping[str, float], times: np.ndarray, quantity: str) -> np.ndarray:
    """The motion at times (s, (n,)), started with theta0, omega0 at times[0]; of nan where it escapes.

    A force that jumps with the velocity turns over within ε, or within a thousandth of the peak velocity where that is
    0: a body that should stick creeps.
    """
    from bayesdamp.physics.trajectories import Trajectories

    whole = {**p, **scales_of(osc, p)}
    return Trajectories(osc, times, quantity, whole).record(whole)
