"""The highest mode that seeds reach, where searches start, and which modes they found."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from bayesdamp.inference.fit.maximise import ROUGHLY, maximise_posterior
from bayesdamp.inference.fit.mode import LocalSearch, Mode, settle
from bayesdamp.inference.model.likelihood import Likelihood
from bayesdamp.inference.model.target import Target
from bayesdamp.outcomes import Status
from bayesdamp.types import Refusal, Seed

SAME_MODE = 1.0
"""Posterior sds within which two ends are one mode."""


def prior_starts(target: Target, count: int, seed: int) -> dict[Seed, Mapping[str, float]]:
    """Draws from the prior: parameter values in natural units."""
    draws = target.prior_draws(count, np.random.default_rng(seed))
    return {
        Seed(f"prior {i + 1}", drawn=True): {n: float(v) for n, v in target.values(z).items()}
        for i, z in enumerate(draws)
    }


def reached(climb: LocalSearch) -> bool:
    """Whether a climb ended at a maximum of finite height."""
    return climb.converged and bool(np.isfinite(climb.end))


def basins(mode: Mode) -> tuple[list[tuple[LocalSearch, float]], list[int | None]]:
    """Tell the modes that the seeds reached, the highest first, and which of them each climb ended in (None: in none).

    Of each mode: the climb to it, and its share of the posterior's mass by Laplace's approximation.
    """
    order = sorted(
        (i for i, c in enumerate(mode.searches) if reached(c)), key=lambda i: -mode.searches[i].end
    )
    tops: list[int] = []
    where: list[int | None] = [None] * len(mode.searches)
    for i in order:
        for number, top in enumerate(tops):
            away = mode.searches[i].z - mode.searches[top].z
            if away @ mode.information @ away < SAME_MODE**2:
                where[i] = number
                break
        else:
            where[i] = len(tops)
            tops.append(i)
    heights = np.array([mode.searches[i].end + mode.searches[i].volume for i in tops])
    # An end without curvature has no volume, and no share.
    heights = np.where(np.isfinite(heights), heights, -np.inf)
    mass = np.exp(heights - max(heights.max(initial=-np.inf), -1e300))
    shares = mass / max(mass.sum(), 1e-300)
    return [(mode.searches[i], float(share)) for i, share in zip(tops, shares, strict=True)], where


COARSEST = 1.0
"""Largest error of a motion in a search, in standard errors of the mean of all samples."""
MOST_LEFT = 1.5
"""What a mode may leave of a record, in standard deviations of that; a motion out of step leaves √2, and more
is left where slow noise stands in for another zero."""
IN_STEP = 0.3
"""What a trajectory that keeps step leaves at most, in the same unit, or a little more than the noise."""
FEWEST = 8
"""Samples that a window must have."""
SAME = 1e-4
"""Scores within which what grew from two seeds is one start."""


def find_mode(
    target: Target,
    seeds: Mapping[Seed, Mapping[str, float]],
    *,
    noise_level: float,
    period: float | None = None,
    thrifty: bool = False,
) -> Mode:
    """The highest mode that the seeds reach.

    seeds: each with its parameter values in natural units. noise_level: the record's roughness, which
    sets how well trajectories are first computed. period: the oscillation's, s; with one, where no seed leads to a
    motion that keeps step with the record, the search goes on over a window that grows from two cycles. thrifty:
    seeds are climbed from only until one leads to such a motion: those that keep step already, then the others over
    growing windows, then these as they are.
    Raises Refusal where no seed reaches a finite posterior with a curvature, or the noise takes the motion's place in
    all that do.
    """
    # A first guess; `settle` measures what the solution's error does to the likelihood.
    tolerance = COARSEST * noise_level / np.sqrt(target.signal.t.size)
    size = float(np.std(target.signal.y))
    in_step = max(IN_STEP * size, 1.5 * noise_level)
    searches: list[LocalSearch] = []
    ends: list[tuple[float, np.ndarray]] = []
    displaced = False
    begun: list[_Begun] = []
    keeps = False

    def begin() -> Iterator[_Begun]:
        """The seeds in turn, each planned when it is asked for."""
        for alike, z in _distinct(target, seeds):
            begun.append(_begun(target, alike, z, tolerance))
            yield begun[-1]

    def stages() -> Iterator[Iterable[_Begun]]:
        if thrifty:
            yield (one for one in begin() if one.left < in_step)
        else:
            yield begin()
        yield _grown(target, begun, tolerance, period)
        if thrifty:
            yield (one for one in begun if not one.left < in_step)

    for stage in stages():
        if keeps:  # and nothing of the next stage is computed
            break
        for (seed, *same), z0, likelihood, start, _ in stage:
            top = maximise_posterior(likelihood, z0, retract=target.followed)
            volume = -0.5 * float(np.linalg.slogdet(top.information)[1])
            searches.append(
                LocalSearch(
                    seed,
                    tuple(same),
                    start,
                    top.value,
                    top.evaluations,
                    z0,
                    top.x,
                    volume,
                    top.converged,
                )
            )
            if not np.isfinite(top.value):
                continue
            left = _size(likelihood.residual(top.x))
            if left > MOST_LEFT * size:
                displaced = True
                continue
            ends.append((top.value, top.x))
            keeps = keeps or left < in_step
            if thrifty and keeps:
                break
    if not ends and displaced:
        raise Refusal(
            Status.PRUNED.because(
                "noise takes the motion's place: the likeliest trajectory is farther from the record than its mean is"
            )
        )
    said = Refusal("no starting point leads to a trajectory with a finite likelihood")
    for _, z in sorted(ends, key=lambda end: -end[0]):
        try:
            return settle(target, z, tolerance, tuple(searches))
        except Refusal as refusal:
            said = refusal
    raise said


class _Begun(NamedTuple):
    """The seeds of a start, its scores (d,) with the noise that they leave, the likelihood near it, the log posterior
    and the root mean square of what is left of the record."""

    seeds: list[Seed]
    z: np.ndarray
    likelihood: Likelihood
    value: float
    left: float


def _begun(target: Target, seeds: list[Seed], z: np.ndarray, tolerance: float) -> _Begun:
    likelihood = Likelihood.near(target, z, tolerance)
    r = likelihood.residual(z)
    z = _with_noise(target, z, r)
    value = likelihood.held(1.0).log_noise(r, z) + float(likelihood.held(1.0).log_prior(z))
    return _Begun(seeds, z, likelihood, value, _size(r))


def _grown(
    target: Target, begun: Sequence[_Begun], tolerance: float, period: float | None
) -> Iterator[_Begun]:
    """Each seed taken along a window that grows from two cycles to the whole record: a frequency that is a little off
    loses step over many cycles, and a likelihood knows no way back from there."""
    if period is None:
        return
    t, y = target.signal.t, target.signal.y
    found: list[np.ndarray] = []
    for one in begun:
        z, window = one.z, 2.0 * period
        while window < t[-1]:
            keep = int(np.searchsorted(t, window))
            window *= 2
            if keep < FEWEST:  # a gap
                continue
            part = replace(target, signal=replace(target.signal, t=t[:keep], y=y[:keep]))
            there = _begun(part, one.seeds, z, tolerance)
            top = maximise_posterior(there.likelihood, there.z, retract=part.followed, close=ROUGHLY)
            z = top.x
            if not np.isfinite(top.value):
                break
        else:
            if not any(np.max(np.abs(z - other)) < SAME for other in found):
                found.append(z)
                yield _begun(target, [replace(seed, grown=True) for seed in one.seeds], z, tolerance)


def _size(r: np.ndarray) -> float:
    return float(np.sqrt(np.mean(r**2)))


def _distinct(
    target: Target, seeds: Mapping[Seed, Mapping[str, float]]
) -> Sequence[tuple[list[Seed], np.ndarray]]:
    """Scores, (d,), each with the seeds that start there: refined estimates that agree are climbed once."""
    found: list[tuple[list[Seed], np.ndarray]] = []
    for seed, values in seeds.items():
        z = target.scores(values)
        there = next((alike for alike, other in found if np.max(np.abs(z - other)) <= 1e-6), None)
        if there is None:
            found.append(([seed], z))
        else:
            there.append(seed)
    return found


def _with_noise(target: Target, z: np.ndarray, r: np.ndarray) -> np.ndarray:
    """Scores (d,) with the noise parameters read from the residuals (n,) there."""
    noise = target.noise_model
    if not np.all(np.isfinite(r)):
        return z
    start = target.scores(noise.start(r, np.diff(target.signal.t)))
    return np.asarray([start[i] if n in noise.parameters else z[i] for i, n in enumerate(target.names)])
