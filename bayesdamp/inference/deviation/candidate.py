"""One candidate, a damping sum under a restoring law: its fit, its linear model, and its weight."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np

from bayesdamp.inference.deviation.data import Data
from bayesdamp.inference.deviation.gaussian.hyperparameters import Grid, grid_of
from bayesdamp.inference.deviation.gaussian.linear import Linear, condensed, normals
from bayesdamp.inference.deviation.least_squares import SEARCHED, Fit, fit, nonnegative
from bayesdamp.inference.deviation.parameters import Parameters
from bayesdamp.inference.model.target import default_prior
from bayesdamp.physics.damping import TERMS
from bayesdamp.physics.kernel import Motion, Solver
from bayesdamp.physics.kernel.solve import ALL, NONE
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.physics.restoring import LAWS
from bayesdamp.priors import Prior
from bayesdamp.types import Reference, candidate_name

STARTS = (-1.0, 0.0, 1.0)
"""Scores of a further parameter from which searches start."""
RELINEARISED = 8
"""Gauss–Newton steps of parameters and deviations together, at most."""
STEPS = ((1.0, 0.0), (0.5, 0.0), (1.0, 10.0), (1.0, 1e3), (1.0, 1e5))
"""Steps that are tried in turn: the share of a step, and how firmly the scores are held. Parameters that a record tells
only together (a spring's angle and gravity, of small swings) would else be sent along a line where their motion
follows a curve, and no share of that step is any better."""
SETTLED = 0.3
"""Largest change of the motion, in standard deviations of the whole record's noise, by a step after which there is no
other."""
MOST_G, MOST_H = 3.0, 0.4
"""Largest log deviation of the damping and deviation of the frequency that are followed."""


@dataclass(frozen=True)
class Candidate:
    """A damping sum, as its terms, under a restoring law."""

    damping: tuple[str, ...]
    restoring: str

    @property
    def name(self) -> str:
        """As `viscous+coulomb@pendulum`."""
        return candidate_name("+".join(self.damping), self.restoring)


@dataclass(frozen=True)
class Linearised:
    """A candidate about one motion: u = (scores, g, h) there, damping being multiplied by exp g and the restoring force
    by 1 + 2h, the linear model, the residual's part that no parameter
    and no deviation takes, (n,)."""

    candidate: Candidate
    fit: Fit
    parameters: Parameters
    u: np.ndarray
    motion: Motion
    model: Linear
    left: np.ndarray


def parameters_of(
    candidate: Candidate,
    solver: Solver,
    data: Data,
    reference: Reference,
    priors: Mapping[str, Prior],
    known: Mapping[str, float],
) -> Parameters:
    """Default priors for what is neither known nor given one."""
    osc = Oscillator(candidate.damping, candidate.restoring)
    found: dict[str, Prior] = {}
    for name in solver.names:
        absent = name not in osc.parameters
        if absent or (name in known and name not in osc.coefficients):
            continue
        found[name] = (
            priors[name] if name in priors else default_prior(name, osc, "gaussian", reference, data.features)
        )
    return Parameters(solver.names, found, {k: v for k, v in known.items() if k not in found})


def first_values(candidate: Candidate, data: Data, known: Mapping[str, float]) -> dict[str, float]:
    """Where a search starts: the record's frequency, its start, and its decay shared by the terms."""
    law = LAWS.get(candidate.restoring)
    fallen = np.log(max(data.amplitude / max(data.final_amplitude, 1e-12), 1.0001))
    ratio = fallen / (2 * np.pi * max(data.cycles, 1.0)) / len(candidate.damping)
    middle = np.sqrt(data.amplitude * max(data.final_amplitude, 1e-3 * data.amplitude))
    found = {
        TERMS.get(t).parameter: ratio / TERMS.get(t).ratio_per_unit(float(middle), data.frequency)
        for t in candidate.damping
    }
    given = {k: v for k, v in known.items() if k in law.parameters}
    return {
        **found,
        **law.start(data.frequency, data.rest, given),
        "theta0": data.start[0],
        "omega0": data.start[1],
    }


def starts_of(candidate: Candidate, parameters: Parameters) -> list[dict[str, float]]:
    """Values of the terms' further parameters that searches start from: low, middle and high in their priors."""
    names = [p.name for t in candidate.damping for p in TERMS.get(t).inferred if p.name in parameters.priors]
    scores = [
        (0.7,) if parameters.priors[n].reflected else (STARTS if len(names) == 1 else STARTS[::2])
        for n in names
    ]
    return [
        {n: float(parameters.priors[n].value(np.asarray(z))) for n, z in zip(names, row, strict=True)}
        for row in product(*scores)
    ]


def active_of(candidate: Candidate, solver: Solver) -> np.ndarray:
    """Which of the solver's terms act in a candidate, (m,)."""
    return np.array([t in candidate.damping for t in solver.terms])


def linearised(
    candidate: Candidate, solver: Solver, data: Data, found: Fit, u: np.ndarray | None = None
) -> Linearised | None:
    """The linear model of a candidate about u = (scores, g, h), its fit with no deviations where that is not given."""
    n = solver.knots.size
    u = np.concatenate([found.z, np.zeros(2 * n)]) if u is None else u
    z, g, h = np.split(u, [found.z.size, found.z.size + n])
    if np.max(np.abs(g), initial=0.0) > MOST_G or np.max(np.abs(h), initial=0.0) > MOST_H:
        return None
    motion = solver.solve(found.parameters.values(z), found.active, np.expm1(g), h, NONE)
    columns = columns_at(solver, found, u, SEARCHED)
    if motion is None or columns is None:
        return None
    r = data.y - motion.y
    model = condensed(columns, r + columns @ u, *_masks(found.parameters))
    # Least squares of r by the columns, from their factor that is there already.
    left = r - columns @ np.linalg.lstsq(model.root, model.target - model.root @ u, rcond=1e-12)[0]
    return Linearised(candidate, found, found.parameters, u, motion, model, left)


def columns_at(
    solver: Solver, found: Fit, u: np.ndarray, tolerance: float | None = None
) -> np.ndarray | None:
    """Return the tangents of a candidate's motion by u = (scores, log g, h), (n, K); None where it escapes."""
    d, n = found.z.size, solver.knots.size
    z, g, h = np.split(u, [d, d + n])
    moved = solver.solve(found.parameters.values(z), found.active, np.expm1(g), h, ALL, tolerance=tolerance)
    if moved is None:
        return None
    scores = found.parameters.by_scores(moved.tangents, z)
    columns = np.column_stack([scores, moved.tangents[:, len(solver.names) :]])
    columns[:, d : d + n] *= np.exp(g)
    return columns


def exact(found: Fit) -> Linear:
    """The linear model of a candidate's fit under exact laws."""
    target = found.residual + found.tangents @ found.z
    return condensed(found.tangents, target, *_masks(found.parameters))


def _masks(parameters: Parameters) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Which scores are positive, share a scale, and are of the damping, (d,) each."""
    return parameters.positive, parameters.shared, parameters.damping


def relinearised(
    candidate: Candidate,
    solver: Solver,
    data: Data,
    found: Fit,
    variance: float | None,
    at: Linearised | None = None,
    near: bool = False,
) -> tuple[Linearised, float] | None:
    """The model about the mode of parameters and deviations together, and the noise's variance of what is left.

    variance: of the noise; None where it is read from what no parameter and no deviation takes. at: where to start, the
    fit with no deviations where that is not given; near: that the mode is near it, and need not be gone to where the
    model has it within `SETTLED`.
    """
    at = at or linearised(candidate, solver, data, found)
    if at is None:
        return None
    grid = grid_of(solver.knots.size, coarse=True, absorbed=found.parameters.absorbs)
    first = 0
    for _ in range(RELINEARISED):
        used = variance if variance is not None else _variance(at, data)
        squares = float(np.sum((data.y - at.motion.y) ** 2))
        there = None
        for i, (share, held) in enumerate(STEPS[first:], first):
            best = mode_of(at.model, grid, used, at.u[: found.z.size], held)
            if near and _far(at, best, used) < SETTLED:
                return at, used
            new = at.u + share * (best - at.u)
            new[: found.z.size] = found.parameters.retracted(
                candidate.restoring, at.u[: found.z.size], new[: found.z.size]
            )
            there = linearised(candidate, solver, data, found, new)
            if there is not None and float(np.sum((data.y - there.motion.y) ** 2)) <= squares * (1 + 1e-6):
                first = max(i - 1, 0)
                break
            there = None
        if there is None:
            break
        moved = _far(there, at.u, used)
        at = there
        if moved < SETTLED:
            break
    return at, variance if variance is not None else _variance(at, data)


def mode_of(
    model: Linear, grid: Grid, variance: float, scores: np.ndarray | None = None, held: float = 0.0
) -> np.ndarray:
    """u at the mode under the likeliest hyperparameters, with no negative coefficient.

    held: how firmly the scores are held where they are (Marquardt's parameter, in units of the prior's information).
    """
    top = int(np.argmax(normals(model, grid, variance, model.count).log))
    d, total = model.positive.size, model.root.shape[1]
    root = np.zeros((total, total))
    root[:d, :d] = np.eye(d)
    root[d:, d:] = grid.factors[top]
    sd = np.sqrt(variance)
    stacked = np.concatenate([model.root @ root / sd, np.eye(total)])
    aim = np.concatenate([model.target / sd, np.zeros(total)])
    positive = np.concatenate([model.positive, np.zeros(total - d, bool)])
    if scores is not None and held > 0:
        stacked = np.concatenate([stacked, np.sqrt(held) * np.eye(d, total)])
        aim = np.concatenate([aim, np.sqrt(held) * scores])
    return root @ nonnegative(stacked, aim, positive)


def _far(at: Linearised, u: np.ndarray, variance: float) -> float:
    """How far another motion is from this one, in standard deviations of the whole record's noise."""
    return float(np.linalg.norm(at.model.root @ (at.u - u))) / np.sqrt(variance)


def _variance(at: Linearised, data: Data) -> float:
    return data.least_variance + float(at.left @ at.left) / max(at.left.size - at.u.size, 1)


def refit(solver: Solver, data: Data, at: Fit) -> Fit | None:
    """Search again from a fit, on other data or with another solver; None where the motion escapes."""
    return fit(solver, at.parameters, at.active, data.y, at.z, noise=data.noise, windows=False)


def searched(
    candidate: Candidate,
    solver: Solver,
    data: Data,
    parameters: Parameters,
    starts: list[Mapping[str, float]],
    windows: bool,
) -> Fit | None:
    """The best of the fits from the starts."""
    best: Fit | None = None
    for start in starts:
        z = parameters.scores({**dict.fromkeys(parameters.free_names, 0.0), **start})
        z[parameters.positive] = np.maximum(z[parameters.positive], 0.0)
        found = fit(
            solver, parameters, active_of(candidate, solver), data.y, z, noise=data.noise, windows=windows
        )
        if found is not None and (best is None or found.squares < best.squares):
            best = found
    return best
