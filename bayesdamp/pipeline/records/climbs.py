"""The stored form of a mode and of the climbs that led to it, both ways."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from bayesdamp.inference.fit.laplace import value_sds
from bayesdamp.inference.fit.mode import Climb, Mode, restore_mode
from bayesdamp.inference.fit.seeds import basins
from bayesdamp.inference.model.target import Target
from bayesdamp.store import CellResult

CLIMB = ("seed", "same", "start", "end", "evaluations", "volume", "converged")
"""What of a climb is stored as it is; its scores are arrays."""
SCORES = ("origin", "z")
"""Scores of a climb, shape (d,) each, stored as one array of all climbs, (climbs, d)."""


def packed(mode: Mode, target: Target, own: Target) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """What a cell keeps of a mode, as its meta and its arrays.

    target: the one the mode is of, which may have idle scores; own: the candidate's alone, whose parameters are shown.
    """
    sds = value_sds(target, mode.z, np.linalg.inv(mode.information))
    meta = {
        "values": {n: float(v) for n, v in target.values(mode.z).items() if n in own.priors},
        "sd": {n: s for n, s in sds.items() if n in own.priors},
        "known": dict(target.known),
        "priors": {n: p.describe() for n, p in own.priors.items()},
        "log_posterior": mode.log_posterior,
        "tolerance": mode.tolerance,
        "error_budget": {
            "step_error": mode.step_error,
            "log_likelihood_change": mode.likelihood_error,
        },
        **_climbs(mode, target, own.names),
    }
    arrays = {"z": mode.z, "information": mode.information}
    return meta, arrays | {f"climbs/{k}": np.array([getattr(c, k) for c in mode.climbs]) for k in SCORES}


def unpacked(cell: CellResult, target: Target) -> Mode:
    """The mode that a cell keeps, of the target that it was packed with."""
    meta, arrays = cell.meta, cell.arrays
    rows = [{k: v for k, v in row.items() if k in CLIMB} for row in meta["climbs"]]
    scores = [dict(zip(SCORES, both)) for both in zip(*(arrays[f"climbs/{k}"] for k in SCORES), strict=True)]
    climbs = tuple(Climb(**row, **at) for row, at in zip(rows, scores, strict=True))
    return restore_mode(
        target, arrays["z"], meta["log_posterior"], arrays["information"], meta["tolerance"], climbs
    )


def alone(mode: Mode, target: Target, own: Target) -> Mode:
    """A mode of `target` in the scores of the candidate alone."""
    live = [i for i, n in enumerate(target.names) if n in own.names]
    return restore_mode(
        own,
        mode.z[live],
        mode.log_posterior,
        mode.information[np.ix_(live, live)],
        mode.tolerance,
        tuple(replace(c, origin=c.origin[live], z=c.z[live]) for c in mode.climbs),
    )


def _climbs(mode: Mode, target: Target, own: tuple[str, ...]) -> dict[str, Any]:
    """What the seeds came to, and the modes that they found.

    own: names of the candidate's own parameters.
    """
    found, where = basins(mode)
    rows = []
    for c, number in zip(mode.climbs, where, strict=True):
        away = c.origin - mode.z
        distance = float(np.sqrt(max(away @ mode.information @ away, 0.0)))
        rows.append({**{k: getattr(c, k) for k in CLIMB}, "distance": distance, "mode": number})
    modes = [
        {
            "log_posterior": b.log_posterior,
            "share": b.share,
            "values": {n: float(v) for n, v in target.values(b.z).items() if n in own},
        }
        for b in found
    ]
    sd = mode.sd()
    touching = [
        n
        for n, z, s, f in zip(target.names, mode.z, sd, target.layout.folded, strict=True)
        if f and n in own and abs(z) < s
    ]
    return {"climbs": rows, "modes": modes, "touching_zero": touching}
