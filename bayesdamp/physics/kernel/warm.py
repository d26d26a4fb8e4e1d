"""Kernels compiled before the first record asks for them."""

from __future__ import annotations

import numpy as np

from bayesdamp.physics.kernel.solve import ALL, SHIPPED, Solver
from bayesdamp.physics.restoring import LAWS


def warm() -> None:
    """Compile the kernel of all that ships, so that the first record need not wait for it."""
    t, law = np.linspace(0.0, 1.0, 5), "linear"
    solver = Solver(SHIPPED, law, t, "angle", 0.1, 4.0, 0.01, np.linspace(0.0, 1.0, 4))
    values = {
        **LAWS.get(law).start(4.0, 0.0, {}),
        "theta0": 0.1,
        "exponent": 1.0,
        "reference_velocity": 0.4,
        "reference_amplitude": 0.1,
        "stribeck_velocity": 0.1,
    }
    p = np.array([values.get(name, 0.0) for name in solver.names])
    active = np.ones(len(SHIPPED), bool)
    solver.solve(p, active, tangents=ALL)
    solver.works(t, t, t, np.ones((1, len(solver.further))), active)
