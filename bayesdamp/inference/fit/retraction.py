"""Steps that follow a restoring law's own curves: where a record shows the frequency and the equilibrium, a straight
step in the law's parameters leaves the ridge at once."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from bayesdamp.inference.model.target import Target

SMALL = 1e-5
"""Share of a step over which directions are taken."""
Retract = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Scores (d,) and a step in them, (d,), to the scores where the curve ends that starts with this step."""


def straight_on(z: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Without a curve."""
    return z + step


def retraction(target: Target) -> Retract:
    """Steps that are straight in the law's `natural` coordinates, where all of its parameters are inferred."""
    law = target.oscillator.law
    names = [n for n in (*law.parameters, "theta0") if n in target.priors]
    if not set(law.parameters) <= set(names) or law.natural({n: 1.0 for n in law.parameters}) is None:
        return straight_on
    places = [target.names.index(n) for n in names]
    known = {"theta0": 0.0, **target.known}

    def coordinates(z: np.ndarray) -> np.ndarray | None:
        values = {n: float(target.priors[n].value(z[i])) for n, i in zip(names, places)}
        found = law.natural({**known, **values})
        return None if found is None else np.array([found[n] for n in names])

    def retract(z: np.ndarray, step: np.ndarray) -> np.ndarray:
        plain, here, beside = z + step, coordinates(z), coordinates(z + SMALL * step)
        if here is None or beside is None:
            return plain
        end = law.from_natural({**known, **dict(zip(names, here + (beside - here) / SMALL))})
        if end is None:
            return plain
        scores = np.array([float(target.priors[n].score(end[n])) for n in names])
        if not np.all(np.isfinite(scores)):
            return plain
        curved = plain.copy()
        curved[places] = scores
        return curved

    return retract
