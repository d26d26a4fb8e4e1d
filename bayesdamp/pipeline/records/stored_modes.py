"""The stored form of a mode and of the searches that led to it, both ways."""

from __future__ import annotations

import numpy as np

from bayesdamp.inference.fit.laplace import value_sds
from bayesdamp.inference.fit.mode import LocalSearch, Mode, restore_mode
from bayesdamp.inference.fit.starting_points import basins
from bayesdamp.inference.model.target import Target
from bayesdamp.store import CellResult
from bayesdamp.store.contents.candidates import Climb, Maximum, ModeContent

CLIMB = ("seed", "same", "start", "end", "evaluations", "volume", "converged")
"""What of a search is stored as it is; its scores are arrays."""
SCORES = ("origin", "z")
"""Scores of a climb, shape (d,) each, stored as one array of all searches, (searches, d)."""


def packed(mode: Mode) -> tuple[ModeContent, dict[str, np.ndarray]]:
    """Return what a cell keeps of a mode, and its arrays."""
    target = mode.likelihood.target
    sds = value_sds(target, mode.z, np.linalg.inv(mode.information))
    climbs, modes, touching = _climbs(mode)
    content = ModeContent(
        values={n: float(v) for n, v in target.values(mode.z).items()},
        sd={n: s for n, s in sds.items()},
        known=dict(target.known),
        priors={n: p.describe() for n, p in target.priors.items()},
        log_posterior=mode.log_posterior,
        tolerance=mode.tolerance,
        error_budget={"step_error": mode.step_error, "log_likelihood_change": mode.likelihood_error},
        climbs=climbs,
        modes=modes,
        touching_zero=touching,
    )
    arrays = {"z": mode.z, "information": mode.information}
    return content, arrays | {f"climbs/{k}": np.array([getattr(c, k) for c in mode.searches]) for k in SCORES}


def unpacked(cell: CellResult, target: Target) -> Mode:
    """The mode that a cell keeps, of the target that it was packed with."""
    content, arrays = ModeContent.of(cell), cell.arrays
    rows = [{k: getattr(climb, k) for k in CLIMB} for climb in content.climbs]
    scores = [dict(zip(SCORES, both)) for both in zip(*(arrays[f"climbs/{k}"] for k in SCORES), strict=True)]
    searches = tuple(LocalSearch(**row, **at) for row, at in zip(rows, scores, strict=True))
    return restore_mode(
        target, arrays["z"], content.log_posterior, arrays["information"], content.tolerance, searches
    )


def _climbs(mode: Mode) -> tuple[tuple[Climb, ...], tuple[Maximum, ...], tuple[str, ...]]:
    """What the seeds came to, the modes that they found, and the coefficients that touch zero."""
    target = mode.likelihood.target
    found, where = basins(mode)
    rows = []
    for c, number in zip(mode.searches, where, strict=True):
        away = c.origin - mode.z
        distance = float(np.sqrt(max(away @ mode.information @ away, 0.0)))
        rows.append(Climb(**{k: getattr(c, k) for k in CLIMB}, distance=distance, mode=number))
    modes = tuple(
        Maximum(b.log_posterior, b.share, {n: float(v) for n, v in target.values(b.z).items()}) for b in found
    )
    sd = mode.sd()
    touching = tuple(
        n for n, z, s, f in zip(target.names, mode.z, sd, target.reflected, strict=True) if f and abs(z) < s
    )
    return tuple(rows), modes, touching
