"""The search for the highest posterior mode from several starts, and the maxima that the searches reach."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from bayesdamp.inference.mode import ROUGH_LAST_STEP, LocalSearch, Mode, maximise_posterior, refine_mode
from bayesdamp.inference.model.likelihood import Likelihood
from bayesdamp.inference.model.target import Target
from bayesdamp.outcomes import Status
from bayesdamp.types import Refusal, Seed

SAME_MODE = 1.0
"""Two searches reached the same maximum if their ends are less than this apart, in posterior standard deviations
(conventional)."""
COARSEST_ERROR = 1.0
"""Largest error of the motion in the first search, in units of the noise's standard deviation divided by √n for a
record of n samples (conventional)."""
MOST_RESIDUAL = 1.5
"""A local maximum of the posterior is rejected if its root mean square residual is more than this many standard
deviations of the record: correlated noise then explains the oscillation instead of the motion. A motion of the right
amplitude but without phase relation to the record has √2."""
IN_PHASE_RESIDUAL = 0.3
"""A motion counts as in phase with the record if its root mean square residual is below this many standard deviations
of the record, or below 1.5 times the noise."""
LEAST_SAMPLES = 8
"""When a search fits the first two cycles of a record, then the first four, eight and so on (`_grow_windows`), a part
with fewer samples than this is skipped."""
SAME_START = 1e-4
"""Two starts of searches count as the same, and are searched from only once, if no standard normal score differs by
this much or more. It applies to starts that were improved by fits to a growing part of the record."""


def prior_starts(target: Target, count: int, seed: int) -> dict[Seed, Mapping[str, float]]:
    """Draw `count` starts of searches from the prior; return the values of each start's parameters, by its `Seed`.

    The values are in the units of the parameters, by their names.
    """
    draws = target.prior_draws(count, np.random.default_rng(seed))
    return {
        Seed(f"prior {i + 1}", drawn=True): {n: float(v) for n, v in target.values(z).items()}
        for i, z in enumerate(draws)
    }


def group_searches(mode: Mode) -> tuple[list[tuple[LocalSearch, float]], list[int | None]]:
    """Group the searches of a mode by the maxima that they reached.

    Returns
    -------
    modes : list of (LocalSearch, float)
        For each maximum, the highest first: its best search, and its fraction of the total posterior probability of the
        maxima, by Laplace's approximation.
    where : list of int or None
        For each search of `mode.searches`: index in `modes` of the maximum that it reached; None if it reached none.
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
    log_masses = np.array([mode.searches[i].end + mode.searches[i].volume for i in tops])
    # A maximum without curvature has no volume and gets no probability.
    log_masses = np.where(np.isfinite(log_masses), log_masses, -np.inf)
    mass = np.exp(log_masses - max(log_masses.max(initial=-np.inf), -1e300))
    fractions = mass / max(mass.sum(), 1e-300)
    return [(mode.searches[i], float(f)) for i, f in zip(tops, fractions, strict=True)], where


class _Start(NamedTuple):
    """A start of a search.

    seeds: all seeds that have this start. z: scores of the start, (d,), with the parameters of the noise estimated from
    the residuals. likelihood: the likelihood near z. value: log posterior at z, with the common prior scale of
    coefficients fixed at 1. rms: root mean square residual at z, in the unit of the record.
    """

    seeds: list[Seed]
    z: np.ndarray
    likelihood: Likelihood
    value: float
    rms: float


def find_mode(
    target: Target,
    seeds: Mapping[Seed, Mapping[str, float]],
    *,
    noise_level: float,
    period: float | None = None,
    thrifty: bool = False,
) -> Mode:
    """Find the highest mode that searches from the seeds reach.

    Maxima whose residual is above `MOST_RESIDUAL` are rejected. If the highest of the others is not a mode with a
    finite posterior and a positive definite information matrix, the next one is tried.

    Parameters
    ----------
    target : Target
        The model with its record and priors.
    seeds : mapping of Seed to mapping of str to float
        Starts of the searches: for each seed the values of the parameters, by name.
    noise_level : float
        Standard deviation of the record's noise, in its unit. It determines how accurately motions are computed in the
        search, and which motions are in phase.
    period : float, optional
        Period of the oscillation in s. If it is given, and no seed leads to a motion in phase with the record (see
        `IN_PHASE_RESIDUAL`), starts are improved by fits to a part of the record that grows from two cycles on.
    thrifty : bool
        Whether to stop at the first motion in phase with the record. Starts are then tried in this order: those whose
        motion is in phase already, then all starts after fits to a growing part of the record, then those whose motion
        is not in phase, unchanged.

    Returns
    -------
    Mode
        The highest mode, with the results of all searches.

    Raises
    ------
    Refusal
        If no seed leads to a finite posterior with a positive definite information matrix, or if at all maxima the
        noise model explains the oscillation instead of the motion.
    """
    # A first tolerance; `refine_mode` then measures the effect of the error on the likelihood.
    tolerance = COARSEST_ERROR * noise_level / np.sqrt(target.signal.t.size)
    size = float(np.std(target.signal.y))
    largest_in_phase = max(IN_PHASE_RESIDUAL * size, 1.5 * noise_level)
    searches: list[LocalSearch] = []
    ends: list[tuple[float, np.ndarray]] = []
    replaced_by_noise = in_phase = False
    distinct: list[tuple[list[Seed], np.ndarray]] = []
    for seed, values in seeds.items():
        z = target.scores(values)
        same = next((group for group, other in distinct if np.max(np.abs(z - other)) <= 1e-6), None)
        if same is None:
            distinct.append(([seed], z))
        else:
            same.append(seed)
    starts = [_start(target, same, z, tolerance) for same, z in distinct]
    stages: tuple[Iterable[_Start], ...] = (starts, _grow_windows(target, starts, tolerance, period))
    if thrifty:
        ready = [start for start in starts if start.rms < largest_in_phase]
        stages = (ready, stages[1], [start for start in starts if not start.rms < largest_in_phase])
    for stage in stages:
        if in_phase:
            break
        for (seed, *same), z0, likelihood, value, _ in stage:
            top = maximise_posterior(likelihood, z0, retract=target.follow_step)
            volume = -0.5 * float(np.linalg.slogdet(top.information)[1])
            cost = top.evaluations
            searches.append(
                LocalSearch(seed, tuple(same), value, top.value, cost, z0, top.x, volume, top.converged)
            )
            if not np.isfinite(top.value):
                continue
            rms = _rms(likelihood.residual(top.x))
            if rms > MOST_RESIDUAL * size:
                replaced_by_noise = True
                continue
            ends.append((top.value, top.x))
            in_phase = in_phase or rms < largest_in_phase
            if thrifty and in_phase:
                break
    if not ends and replaced_by_noise:
        raise Refusal(
            Status.PRUNED.because(
                "the noise model explains the oscillation instead of the motion: the most probable motion is farther "
                "from the record than the record's mean"
            )
        )
    failure = Refusal("no start of the search leads to a motion with a finite likelihood")
    for _, z in sorted(ends, key=lambda end: -end[0]):
        try:
            return refine_mode(target, z, tolerance, tuple(searches))
        except Refusal as refusal:
            failure = refusal
    raise failure


def _start(target: Target, seeds: list[Seed], z: np.ndarray, tolerance: float) -> _Start:
    """Return the start at scores z, (d,); parameters of the noise are estimated from the residuals there, if finite.

    seeds: origins of z. tolerance: largest error of the motion, in the unit of the record.
    """
    likelihood = Likelihood.near(target, z, tolerance)
    r = likelihood.residual(z)
    if np.all(np.isfinite(r)):
        noise = target.noise_model
        estimate = target.scores(noise.start(r, np.diff(target.signal.t)))
        z = np.asarray([estimate[i] if n in noise.parameters else z[i] for i, n in enumerate(target.names)])
    one_scale = likelihood.with_scale(1.0)
    return _Start(seeds, z, likelihood, one_scale.log_noise(r, z) + float(one_scale.log_prior(z)), _rms(r))


def _grow_windows(
    target: Target, starts: Sequence[_Start], tolerance: float, period: float | None
) -> Iterator[_Start]:
    """Yield each start after fits to the first two cycles of the record, then to the first four, eight and so on.

    The window is doubled while it is shorter than the record; the fit to the whole record is left to the caller. In a
    record of less than two cycles the start is not fitted. The parameters of the noise in each result are estimated
    from its residuals (`_start`). Nothing is yielded without a period, for a start whose fit is not finite, or for a
    result that equals an earlier one (`SAME_START`). The reason: a motion with a slightly wrong frequency loses the
    phase over many cycles, and a search in the whole record cannot recover it. tolerance: largest error of a motion, in
    the unit of the record. period: in s.
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
            if count < LEAST_SAMPLES:  # there is a gap
                continue
            part = replace(target, signal=replace(target.signal, t=t[:count], y=y[:count]))
            first = _start(part, start.seeds, z, tolerance)
            top = maximise_posterior(
                first.likelihood, first.z, retract=part.follow_step, close=ROUGH_LAST_STEP
            )
            z = top.x
            if not np.isfinite(top.value):
                break
        else:
            if not any(np.max(np.abs(z - other)) < SAME_START for other in grown):
                grown.append(z)
                yield _start(target, [replace(seed, grown=True) for seed in start.seeds], z, tolerance)


def _rms(r: np.ndarray) -> float:
    """Return the root mean square of residuals r, (n,), in their unit."""
    return float(np.sqrt(np.mean(r**2)))
