"""Which plan is made for a record: how a motion is solved, and how finely."""

from __future__ import annotations

from functools import partial

import numpy as np

from bayesdamp.physics.kernel.trajectory import trajectory
from bayesdamp.physics.oscillator import Oscillator, Parameters
from bayesdamp.physics.solver import cycles, friction
from bayesdamp.physics.solver.mesh import frozen_mesh
from bayesdamp.physics.solver.plan import QUANTITIES, Plan
from bayesdamp.physics.solver.steps import MeshPlan, mesh_plan
from bayesdamp.physics.solver.tableau import ORDER

FIRST_RESOLUTION = 0.6
Stepped = MeshPlan | friction.TurningPlan
ENOUGH = 20_000
"""Samples at which the error of a plan is looked at; of more, that many spread over the record."""


def plan_of(
    osc: Oscillator, p: Parameters, times: np.ndarray, quantity: str, tolerance: float
) -> tuple[Plan, float]:
    """`plan_with_error`, of cycles where the record has very many of them, smooth in all parameters near `p`."""
    if not is_exact(osc, p):
        found = cycles.plan_with_error(osc, p, times - times[0], QUANTITIES.index(quantity), tolerance)
        if found is not None:
            return found
    return plan_with_error(osc, p, times, quantity, tolerance)


def is_exact(osc: Oscillator, p: Parameters) -> bool:
    """Whether friction is the sign itself: ε = 0 and a term that switches."""
    return osc.switches and float(p["epsilon"]) == 0.0


def make_plan(
    osc: Oscillator,
    p: Parameters,
    times: np.ndarray,
    quantity: str = "angle",
    tolerance: float = 1e-8,
) -> Stepped:
    """A plan for parameters near `p` whose trajectory is within `tolerance` of the exact one at `p`.

    times: the samples in s, shape (n,), not decreasing; the motion starts with theta0, omega0 at times[0].
    tolerance: largest error in the unit of the quantity; steps are shortened until halving them shows less.
    """
    return plan_with_error(osc, p, times, quantity, tolerance)[0]


def plan_with_error(
    osc: Oscillator,
    p: Parameters,
    times: np.ndarray,
    quantity: str = "angle",
    tolerance: float = 1e-8,
) -> tuple[Stepped, float]:
    """`make_plan`, and the largest difference that halving its steps makes at `p`, shape ()."""
    times = np.asarray(times, float) - float(times[0])
    if times.size > ENOUGH:
        some = times[np.linspace(0, times.size - 1, ENOUGH).astype(int)]
        plan, error = plan_with_error(osc, p, some, quantity, tolerance)
        return plan.at(times, quantity), error
    p = {name: np.float64(p[name]) for name in osc.inputs}
    resolution, best = FIRST_RESOLUTION, None
    order = ORDER - QUANTITIES.index(quantity)  # each derivative of the dense output costs one
    for _ in range(6):
        coarse, fine = _pair(osc, p, times, quantity, resolution)
        change = float(np.max(np.abs(coarse.at_samples(osc, p) - fine.at_samples(osc, p))))
        if not np.isfinite(change) or change <= tolerance:
            return coarse, change
        if best is not None and change > 0.5 * best[1]:
            break  # rounding has been reached
        finer = change / 2 ** (order - 1)
        best = (fine, finer) if best is None or finer < best[1] else best
        resolution *= min(max(1.1 * (change / tolerance) ** (1 / order), 1.15), 4.0)
    assert best is not None
    return best


def _pair(
    osc: Oscillator, p: Parameters, times: np.ndarray, quantity: str, resolution: float
) -> tuple[Stepped, Stepped]:
    if is_exact(osc, p):
        make = partial(friction.turning_plan, osc, p, times, quantity)
        return make(resolution), make(2 * resolution)
    mesh = frozen_mesh(osc, p, max(float(times[-1]), 1e-300), resolution)
    halved = np.empty(2 * mesh.size - 1)
    halved[::2], halved[1::2] = mesh, 0.5 * (mesh[:-1] + mesh[1:])
    return mesh_plan(mesh, times, quantity, parts=2), mesh_plan(halved, times, quantity)


def simulate(
    osc: Oscillator,
    p: Parameters,
    times: np.ndarray,
    quantity: str = "angle",
    tolerance: float = 1e-9,
) -> np.ndarray:
    """Return the oscillator's record at `times` (s, shape (n,)), started with theta0, omega0 at times[0].

    tolerance: error in the unit of the quantity. What comes after an escape is nan. With epsilon 0 friction is exact.

    Raises ValueError where a parameter is missing or the quantity unknown, Refusal where a damping term or the law has
    no kernel.
    """
    missing = [name for name in osc.parameters if name not in p]
    if missing:
        raise ValueError(f"parameter {missing[0]!r} is missing; needed are {', '.join(osc.parameters)}")
    if quantity not in QUANTITIES:
        raise ValueError(f"quantity {quantity!r} is none of {', '.join(QUANTITIES)}")
    return trajectory(osc, {n: float(v) for n, v in p.items()}, times, quantity, tolerance)
