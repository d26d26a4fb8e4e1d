"""The search for the highest posterior mode from several starts, and the maxima that the searches reach."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from bayesdamp.inference.mode import LocalSearch, Mode, maximise_posterior
from bayesdamp.inference.model.likelihood import Likelihood
from bayesdamp.inference.model.target import Target
from bayesdamp.outcomes import Status
from bayesdamp.types import Refusal

SAME_MODE = 1.0
"""Two searches reached the same maximum if their ends are less than this apart, in posterior standard deviations
(conventional)."""
SEARCH_ERROR, MODE_ERROR = 1.0, 0.03
"""Largest error of the motion in the searches, and at the mode and in all later computations, in units of the noise's
standard deviation divided by √n for a record of n samples. With the second value the error changes the log likelihood
within three posterior standard deviations of the mode by less than 0.01 nats (measured on 20 simulated records)."""
MOST_RESIDUAL = 1.5
"""A local maximum of the posterior is rejected if its root mean square residual is more than this many standard
deviations of the record: correlated noise then explains the oscillation instead of the motion. A motion of the right
amplitude but without phase relation to the record has √2."""


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


def find_mode(target: Target, starts: Iterable[Mapping[str, float]], *, noise_level: float) -> Mode:
    """Find the highest mode that searches from the given starts reach.

    Maxima whose residual is above `MOST_RESIDUAL` are rejected.

    Parameters
    ----------
    target : Target
        The model with its record and priors.
    starts : iterable of mapping of str to float
        Starts of the searches: for each the values of the parameters, by name. Parameters of the noise are estimated
        from the residuals at the start instead.
    noise_level : float
        Standard deviation of the record's noise, in its unit. It determines how accurately motions are computed in the
        search.

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
    noise, unit = target.noise_model, noise_level / np.sqrt(target.signal.t.size)
    largest = MOST_RESIDUAL * float(np.std(target.signal.y))
    searches: list[LocalSearch] = []
    ends: list[LocalSearch] = []
    for start in starts:
        z = target.scores(start)
        likelihood = Likelihood.near(target, z, SEARCH_ERROR * unit)
        residual = likelihood.residual(z)
        if np.all(np.isfinite(residual)):
            estimate = target.scores(noise.start(residual, np.diff(target.signal.t)))
            z = np.where([name in noise.parameters for name in target.names], estimate, z)
        top = maximise_posterior(likelihood, z, retract=target.follow_step)
        is_motion = np.sqrt(np.mean(likelihood.residual(top.x) ** 2)) <= largest
        volume = _log_volume(top.information)
        searches.append(LocalSearch(z, top.x, top.value, volume, top.converged and bool(is_motion)))
        if is_motion and np.isfinite(top.value):
            ends.append(searches[-1])
    if not ends and any(np.isfinite(search.end) for search in searches):
        raise Refusal(
            Status.PRUNED.because(
                "the noise model explains the oscillation instead of the motion: the most probable motion is farther "
                "from the record than the record's mean"
            )
        )
    if not ends:
        raise Refusal("no start of the search leads to a motion with a finite likelihood")
    highest = max(ends, key=lambda search: search.end)
    likelihood = Likelihood.near(target, highest.z, MODE_ERROR * unit)
    top = maximise_posterior(likelihood, highest.z)
    if not np.isfinite(top.value):
        raise Refusal("the posterior is not finite at its mode")
    mode = Mode(top.x, top.value, top.information, likelihood, tuple(searches))
    mode.sd()  # raises Refusal if the information is not positive definite
    return mode


def _log_volume(information: np.ndarray) -> float:
    """Return −½ log det of an information matrix, (d, d); −∞ if its determinant is not positive."""
    sign, log_determinant = np.linalg.slogdet(information)
    return -0.5 * float(log_determinant) if sign > 0 else -np.inf
