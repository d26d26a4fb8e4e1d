"""The search for the highest mode: where climbs start, and which modes they reach."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from bayesdamp.inference.mode import ROUGHLY, LocalSearch, Mode, maximise_posterior, settle
from bayesdamp.inference.model.likelihood import Likelihood
from bayesdamp.inference.model.target import Target
from bayesdamp.outcomes import Status
from bayesdamp.types import Refusal, Seed

SAME_MODE = 1.0
"""Two ends within this many posterior sds are one mode."""
COARSEST = 1.0
"""Largest error of a motion in a search, in standard errors of the mean of all samples."""
MOST_LEFT = 1.5
"""Largest residual of a mode, in standard deviations of the record. A motion out of step leaves √2; more is left where
slow noise replaces a shift of the zero."""
IN_STEP = 0.3
"""Largest residual of a motion that keeps step with the record, in the same unit; a little more than the noise is
allowed too."""
FEWEST = 8
"""Smallest number of samples in a window."""
SAME_START = 1e-4
"""Starts within this many scores of each other are one start."""


def prior_starts(target: Target, count: int, seed: int) -> dict[Seed, Mapping[str, float]]:
    """Draw starts from the prior: parameter values in natural units."""
    draws = target.prior_draws(count, np.random.default_rng(seed))
    return {
        Seed(f"prior {i + 1}", drawn=True): {n: float(v) for n, v in target.values(z).items()}
        for i, z in enumerate(draws)
    }


def basins(mode: Mode) -> tuple[list[tuple[LocalSearch, float]], list[int | None]]:
    """Group the climbs of a search by the modes that they reached.

    Returns
    -------
    modes : list of (LocalSearch, float)
        The climb to each mode, the highest first, and its share of the posterior's mass by Laplace's approximation.
    where : list of int or None
        Index of the mode that each climb reached, None where it reached none.
    """
    reached = [i for i, c in enumerate(mode.searches) if c.converged and np.isfinite(c.end)]
    tops: list[int] = []
    where: list[int | None] = [None] * len(mode.searches)
    for i in sorted(reached, key=lambda i: -mode.searches[i].end):
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


class _Start(NamedTuple):
    """A start of a climb.

    Its seeds; its scores, (d,), with the noise of the residuals there; the likelihood near it; the log posterior; and
    the root mean square of the residuals.
    """

    seeds: list[Seed]
    z: np.ndarray
    likelihood: Likelihood
    value: float
    left: float


def find_mode(
    target: Target,
    seeds: Mapping[Seed, Mapping[str, float]],
    *,
    noise_level: float,
    period: float | None = None,
    thrifty: bool = False,
) -> Mode:
    """Find the highest mode that climbs from the seeds reach.

    Parameters
    ----------
    target : Target
        Whose posterior it is.
    seeds : mapping of Seed to mapping of str to float
        Parameter values of each seed, in natural units.
    noise_level : float
        The record's roughness, which sets how finely motions are first solved.
    period : float, optional
        Period of the oscillation in s. With it, where no seed leads to a motion that keeps step with the record, the
        search goes on over a window that grows from two cycles.
    thrifty : bool
        Whether to stop at the first motion that keeps step. Seeds are then tried in this order: those that keep step
        already, the others over growing windows, the others as they are.

    Raises
    ------
    Refusal
        Where no seed reaches a finite posterior with a curvature, or where the noise model replaces the motion in all
        that do.
    """
    # A first guess; `settle` measures the effect of the solution's error on the likelihood.
    tolerance = COARSEST * noise_level / np.sqrt(target.signal.t.size)
    size = float(np.std(target.signal.y))
    in_step = max(IN_STEP * size, 1.5 * noise_level)
    searches: list[LocalSearch] = []
    ends: list[tuple[float, np.ndarray]] = []
    starts: list[_Start] = []
    displaced = keeps_step = False

    def planned() -> Iterator[_Start]:
        """Plan each start when it is asked for; refined estimates that agree are one start."""
        distinct: list[tuple[list[Seed], np.ndarray]] = []
        for seed, values in seeds.items():
            z = target.scores(values)
            same = next((own for own, other in distinct if np.max(np.abs(z - other)) <= 1e-6), None)
            if same is None:
                distinct.append(([seed], z))
            else:
                same.append(seed)
        for same, z in distinct:
            starts.append(_begun(target, same, z, tolerance))
            yield starts[-1]

    def stages() -> Iterator[Iterable[_Start]]:
        if thrifty:
            yield (start for start in planned() if start.left < in_step)
        else:
            yield planned()
        yield _grown(target, starts, tolerance, period)
        if thrifty:
            yield (start for start in starts if not start.left < in_step)

    for stage in stages():
        if keeps_step:  # and nothing of the next stage is computed
            break
        for (seed, *same), z0, likelihood, height, _ in stage:
            top = maximise_posterior(likelihood, z0, retract=target.followed)
            volume = -0.5 * float(np.linalg.slogdet(top.information)[1])
            cost = top.evaluations
            searches.append(
                LocalSearch(seed, tuple(same), height, top.value, cost, z0, top.x, volume, top.converged)
            )
            if not np.isfinite(top.value):
                continue
            left = _rms(likelihood.residual(top.x))
            if left > MOST_LEFT * size:
                displaced = True
                continue
            ends.append((top.value, top.x))
            keeps_step = keeps_step or left < in_step
            if thrifty and keeps_step:
                break
    if not ends and displaced:
        raise Refusal(
            Status.PRUNED.because(
                "the noise model replaces the motion: the most probable motion is farther from the record than the "
                "record's mean is"
            )
        )
    failure = Refusal("no starting point leads to a motion with a finite likelihood")
    for _, z in sorted(ends, key=lambda end: -end[0]):
        try:
            return settle(target, z, tolerance, tuple(searches))
        except Refusal as refusal:
            failure = refusal
    raise failure


def _begun(target: Target, seeds: list[Seed], z: np.ndarray, tolerance: float) -> _Start:
    """Return a start at scores z, (d,), its noise parameters estimated from the residuals there."""
    likelihood = Likelihood.near(target, z, tolerance)
    r = likelihood.residual(z)
    if np.all(np.isfinite(r)):
        noise = target.noise_model
        estimate = target.scores(noise.start(r, np.diff(target.signal.t)))
        z = np.asarray([estimate[i] if n in noise.parameters else z[i] for i, n in enumerate(target.names)])
    one_scale = likelihood.with_scale(1.0)
    return _Start(seeds, z, likelihood, one_scale.log_noise(r, z) + float(one_scale.log_prior(z)), _rms(r))


def _grown(
    target: Target, starts: Sequence[_Start], tolerance: float, period: float | None
) -> Iterator[_Start]:
    """Take each start along a window that grows from two cycles to the whole record.

    A motion whose frequency is slightly off loses step over many cycles, and no climb leads back from there.
    """
    if period is None:
        return
    t, y = target.signal.t, target.signal.y
    grown: list[np.ndarray] = []
    for start in starts:
        z, window = start.z, 2.0 * period
        while window < t[-1]:
            count = int(np.searchsorted(t, window))
            window *= 2
            if count < FEWEST:  # a gap
                continue
            part = replace(target, signal=replace(target.signal, t=t[:count], y=y[:count]))
            first = _begun(part, start.seeds, z, tolerance)
            top = maximise_posterior(first.likelihood, first.z, retract=part.followed, close=ROUGHLY)
            z = top.x
            if not np.isfinite(top.value):
                break
        else:
            if not any(np.max(np.abs(z - other)) < SAME_START for other in grown):
                grown.append(z)
                yield _begun(target, [replace(seed, grown=True) for seed in start.seeds], z, tolerance)


def _rms(r: np.ndarray) -> float:
    return float(np.sqrt(np.mean(r**2)))
