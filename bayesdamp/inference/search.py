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
from bayesdamp.types import Refusal

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


def prior_starts(target: Target, count: int, seed: int) -> list[dict[str, float]]:
    """Draw `count` starts of searches from the prior; return the values of each start's parameters, by name.

    The values are in the units of the parameters. seed: of the draws.
    """
    draws = target.prior_draws(count, np.random.default_rng(seed))
    return [{n: float(v) for n, v in target.values(z).items()} for z in draws]


def group_searches(mode: Mode) -> list[tuple[np.ndarray, float]]:
    """Group the searches of a mode by the maxima that they reached.

    Returns
    -------
    list of (ndarray, float)
        For each maximum its scores, (d,), and its fraction of the total posterior probability of the maxima, by
        Laplace's approximation: first the mode itself, then the others, the highest first.
    """
    maxima = [mode.z]
    log_masses = [mode.log_posterior + _log_volume(mode.information)]
    for search in sorted(mode.searches, key=lambda search: -search.end):
        away = [search.z - z for z in maxima]
        if search.converged and all(x @ mode.information @ x >= SAME_MODE**2 for x in away):
            maxima.append(search.z)
            log_masses.append(search.end + search.volume)
    masses = np.exp(np.array(log_masses) - max(log_masses))
    return list(zip(maxima, (masses / masses.sum()).tolist(), strict=True))


class _Start(NamedTuple):
    """A start of a search.

    z: scores of the start, (d,), with the parameters of the noise estimated from the residuals. likelihood: the
    likelihood near z. rms: root mean square residual at z, in the unit of the record.
    """

    z: np.ndarray
    likelihood: Likelihood
    rms: float


def find_mode(
    target: Target,
    given: Sequence[Mapping[str, float]],
    *,
    noise_level: float,
    period: float | None = None,
    thrifty: bool = False,
) -> Mode:
    """Find the highest mode that searches from the given starts reach.

    Maxima whose residual is above `MOST_RESIDUAL` are rejected. If the highest of the others is not a mode with a
    finite posterior and a positive definite information matrix, the next one is tried.

    Parameters
    ----------
    target : Target
        The model with its record and priors.
    given : sequence of mapping of str to float
        Starts of the searches: for each the values of the parameters, by name. Of equal ones only the first is used.
    noise_level : float
        Standard deviation of the record's noise, in its unit. It determines how accurately motions are computed in the
        search, and which motions are in phase.
    period : float, optional
        Period of the oscillation in s. If it is given, and no start leads to a motion in phase with the record (see
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
        If no start leads to a finite posterior with a positive definite information matrix, or if at all maxima the
        noise model explains the oscillation instead of the motion.
    """
    # A first tolerance; `refine_mode` then measures the effect of the error on the likelihood.
    tolerance = COARSEST_ERROR * noise_level / np.sqrt(target.signal.t.size)
    size = float(np.std(target.signal.y))
    largest_in_phase = max(IN_PHASE_RESIDUAL * size, 1.5 * noise_level)
    searches: list[LocalSearch] = []
    ends: list[tuple[float, np.ndarray]] = []
    replaced_by_noise = in_phase = False
    distinct: list[np.ndarray] = []
    for z in map(target.scores, given):
        if not any(np.max(np.abs(z - other)) <= 1e-6 for other in distinct):
            distinct.append(z)
    starts = [_start(target, z, tolerance) for z in distinct]
    stages: tuple[Iterable[_Start], ...] = (starts, _grow_windows(target, starts, tolerance, period))
    if thrifty:
        ready = [start for start in starts if start.rms < largest_in_phase]
        stages = (ready, stages[1], [start for start in starts if not start.rms < largest_in_phase])
    for stage in stages:
        if in_phase:
            break
        for z0, likelihood, _ in stage:
            top = maximise_posterior(likelihood, z0, retract=target.follow_step)
            rms = _rms(likelihood.residual(top.x)) if np.isfinite(top.value) else np.inf
            is_motion = rms <= MOST_RESIDUAL * size
            volume = _log_volume(top.information)
            searches.append(LocalSearch(z0, top.x, top.value, volume, top.converged and is_motion))
            if not np.isfinite(top.value):
                continue
            if not is_motion:
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


def _start(target: Target, z: np.ndarray, tolerance: float) -> _Start:
    """Return the start at scores z, (d,); parameters of the noise are estimated from the residuals there, if finite.

    tolerance: largest error of the motion, in the unit of the record.
    """
    likelihood = Likelihood.near(target, z, tolerance)
    r = likelihood.residual(z)
    if np.all(np.isfinite(r)):
        noise = target.noise_model
        estimate = target.scores(noise.start(r, np.diff(target.signal.t)))
        z = np.asarray([estimate[i] if n in noise.parameters else z[i] for i, n in enumerate(target.names)])
    return _Start(z, likelihood, _rms(r))


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
            first = _start(part, z, tolerance)
            top = maximise_posterior(
                first.likelihood, first.z, retract=part.follow_step, close=ROUGH_LAST_STEP
            )
            z = top.x
            if not np.isfinite(top.value):
                break
        else:
            if not any(np.max(np.abs(z - other)) < SAME_START for other in grown):
                grown.append(z)
                yield _start(target, z, tolerance)


def _rms(r: np.ndarray) -> float:
    """Return the root mean square of residuals r, (n,), in their unit."""
    return float(np.sqrt(np.mean(r**2)))


def _log_volume(information: np.ndarray) -> float:
    """Return −½ log det of an information matrix, (d, d); −∞ if its determinant is not positive."""
    sign, log_determinant = np.linalg.slogdet(information)
    return -0.5 * float(log_determinant) if sign > 0 else -np.inf
