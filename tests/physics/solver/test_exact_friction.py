"""ε = 0 in the solver that JAX differentiates: the closed form of the linear spring is the truth."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np

from bayesdamp.physics.integrate import make_plan
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.physics.solver.plan import compiled_record
from tests.physics.independent import with_coulomb

TIMES = np.linspace(0.0, 10.0, 1003)
COULOMB = Oscillator(("coulomb",), "linear")
P = {"mu_c": 0.3, "stiffness": 20.0, "rest_angle": 0.05, "epsilon": 0.0, "theta0": 0.35, "omega0": 1.3}


def test_motion_and_tangents():
    """Forward tangents through turning points and sticking against central differences of the closed form."""
    plan = make_plan(COULOMB, P, TIMES, tolerance=1e-7)
    run = compiled_record(COULOMB)
    values = {n: jnp.asarray(P[n]) for n in COULOMB.parameters}
    assert np.max(np.abs(run(plan, values) - with_coulomb(P, TIMES)[:, 0])) < 1.5e-7
    for name in ("mu_c", "stiffness", "theta0", "omega0"):
        direction = {n: jnp.asarray(float(n == name)) for n in values}
        tangent = np.asarray(jax.jvp(lambda q: run(plan, q), (values,), (direction,))[1])
        d = 1e-6 * max(1.0, abs(P[name]))
        up, down = ({**P, name: P[name] + s * d} for s in (1, -1))
        difference = (with_coulomb(up, TIMES)[:, 0] - with_coulomb(down, TIMES)[:, 0]) / (2 * d)
        assert np.max(np.abs(tangent - difference)) < 2e-4 * max(1.0, float(np.max(np.abs(difference))))
