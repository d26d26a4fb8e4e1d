"""Inferred parameters as monotone maps of standard normal scores, and steps that follow a restoring law's curves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property

import numpy as np

from bayesdamp.physics.restoring import LAWS
from bayesdamp.priors import SHARED_SIGMAS, Prior, SharedHalfNormal, shared_precision

AT_ZERO = 1e-12
"""Where the slope of a reflected map is taken at zero, where it has none."""
SMALL = 1e-6
"""Share of a step over which directions are taken."""


class Scores:
    """The prior is N(0, 1) in each score, but for coefficients whose priors share an unknown scale."""

    priors: Mapping[str, Prior]
    """Of the inferred parameters, in the order of the scores."""
    known: Mapping[str, float]
    scales: tuple[float, ...] = tuple(map(float, SHARED_SIGMAS))
    """Scales that coefficients may share, in scores, all equally probable."""

    @cached_property
    def reflected(self) -> np.ndarray:
        """Which of the scores, (d,), are those of half-normal priors: z and −z stand for one value."""
        return np.array([p.reflected for p in self.priors.values()], bool)

    @cached_property
    def shared(self) -> np.ndarray:
        """Which of the scores, (d,), are coefficients whose priors share an unknown scale."""
        return np.array([isinstance(p, SharedHalfNormal) for p in self.priors.values()], bool)

    def prior_precision(
        self, z: np.ndarray, scales: Sequence[float] | np.ndarray = SHARED_SIGMAS
    ) -> np.ndarray:
        """Return what each score, (d,), is multiplied by to give minus the slope of its log prior, (d,).

        It is 1, and for scores that share a scale the mean of 1/σ² over the scales. It is also a curvature that the log
        prior nowhere exceeds: that of the normal that touches it at z from below.
        """
        found, shared = np.ones(z.size), self.shared
        if shared.any():
            squares = np.sum(z[shared] ** 2)
            found[shared] = shared_precision(squares, int(shared.sum()), np.asarray(scales))
        return found

    def prior_draws(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """Draw scores from the prior, (n, d), not negative where they are reflected."""
        z = rng.standard_normal((count, len(self.priors)))
        if self.shared.any():
            z[:, self.shared] *= rng.choice(self.scales, count)[:, None]
        z[:, self.reflected] = np.abs(z[:, self.reflected])
        return z

    @cached_property
    def _rates(self):
        return [(type(p).derivative, p.numbers, p.reflected) for p in self.priors.values()]

    def rates(self, z: np.ndarray) -> np.ndarray:
        """Return by how much each inferred parameter changes with its score at z, both (d,)."""
        both = zip(self._rates, z.tolist(), strict=True)
        return np.array(
            [rate((z or AT_ZERO) if reflected else z, *numbers) for (rate, numbers, reflected), z in both],
            float,
        )

    def retracted(self, restoring: str, z: np.ndarray, new: np.ndarray) -> np.ndarray:
        """Return where a step from scores z to `new`, both (d,), leads along the restoring law's natural coordinates.

        To first order it is the same, but a step along which a record shows little stays where it shows little. It is
        `new` where the law has no such coordinates, or not all of its parameters are inferred.

        References
        ----------
        P.-A. Absil, R. Mahony and R. Sepulchre, Optimization Algorithms on Matrix Manifolds, 2008, on retractions.
        """
        law, priors = LAWS.get(restoring), self.priors
        names = [n for n in (*law.parameters, "theta0") if n in priors]
        if not set(law.parameters) <= set(names):
            return new
        order, known = list(priors), {"theta0": 0.0, **self.known}
        places = [order.index(n) for n in names]

        def coordinates(z: np.ndarray) -> np.ndarray | None:
            values = {n: float(priors[n].value(z[i])) for n, i in zip(names, places, strict=True)}
            found = law.natural({**known, **values})
            return None if found is None else np.array([found[n] for n in names])

        here = coordinates(z)
        beside = None if here is None else coordinates(z + SMALL * (new - z))
        if here is None or beside is None:
            return new
        ends = here + (beside - here) / SMALL
        end = law.from_natural({**known, **dict(zip(names, ends.tolist(), strict=True))})
        if end is None:
            return new
        along = np.array([float(priors[n].score(end[n])) for n in names])
        if not np.all(np.isfinite(along)):
            return new
        curved = new.copy()
        curved[places] = along
        return curved
