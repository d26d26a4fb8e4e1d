"""A candidate whose laws may hold approximately: its numbers, its motions, and draws of them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from bayesdamp.inference.deviation.gaussian.hyperparameters import grid_of
from bayesdamp.inference.deviation.numbers.curves import ratio_at, ratios_drawn
from bayesdamp.inference.deviation.numbers.deviations import size_of
from bayesdamp.inference.deviation.numbers.draws import Drawn, scores_of
from bayesdamp.inference.deviation.numbers.quantities import Quantity, Ratio, quantity
from bayesdamp.inference.deviation.single import Single
from bayesdamp.machine.threads import at_once
from bayesdamp.physics.kernel.solve import NONE
from bayesdamp.physics.oscillator import Oscillator

Array = NDArray[np.float64]
DRAWS = 4000
"""Of the linear model, behind values and intervals: an end of an interval is good to a thirtieth of its width."""


@dataclass(frozen=True)
class Approximate:
    """A candidate with deviations of its damping and restoring laws, linear about its best motion, and what is asked
    of it.

    single: what was weighed; sensor: relative sd below which no damping ratio is known.
    """

    single: Single
    sensor: float

    @cached_property
    def scores(self) -> Array:
        """Draws of the linear model: scores, log g and h at the knots, (n, K)."""
        result = self.single.result
        assert result.weighed is not None
        return scores_of(result.weighed, result.fit.parameters.positive, DRAWS, np.random.default_rng(0))

    @property
    def names(self) -> tuple[str, ...]:
        """Of the inferred parameters."""
        return self.single.result.fit.parameters.free_names

    @property
    def oscillator(self) -> Oscillator:
        """Its laws, as if they held exactly."""
        candidate = self.single.result.candidate
        return Oscillator(candidate.damping, candidate.restoring)

    @property
    def known(self) -> dict[str, float]:
        """What is held: parameters, friction's width where there is any, and the noise's sd of a sample."""
        weighing = self.single.weighing
        own = (*self.oscillator.parameters, "noise_sd")
        found = {n: v for n, v in self.single.found.known.items() if n in own}
        found |= {"epsilon": weighing.epsilon} if self.oscillator.switches else {}
        variance = weighing.variance / weighing.inflation * weighing.data.thinned
        return {**found, "noise_sd": float(np.sqrt(variance))}

    def values(self, u: Array) -> Array:
        """Inferred parameters in natural units of draws (..., K): (..., p)."""
        parameters = self.single.result.fit.parameters
        return parameters.values(u[..., : parameters.free.size])[..., parameters.free]

    def quantities(self) -> dict[str, Quantity]:
        """Each inferred parameter: median, 95 % interval, and the parts of its sd."""
        values, noise = self.values(self.scores), self.noise_sds
        return {
            n: quantity(values[:, i], min(noise[n], float(np.std(values[:, i]))))
            for i, n in enumerate(self.names)
        }

    @cached_property
    def noise_sds(self) -> dict[str, float]:
        """The sd that noise alone would leave of each inferred parameter, were the laws exact."""
        result, parameters = self.single.result, self.single.result.fit.parameters
        sds = np.linalg.norm(result.exact_weighed.factors[0], axis=1) * np.abs(
            parameters.slopes(result.fit.z)
        )
        sds = sds * np.sqrt(self.single.weighing.variance / result.exact_variance)
        return dict(zip(self.names, map(float, sds), strict=True))

    def deviations(self, u: Array) -> tuple[Array, Array]:
        """Log g and h at the knots of draws (n, K): (n, k) each."""
        d, k = self.single.result.fit.z.size, self.knots.size
        return u[:, d : d + k], u[:, d + k :]

    @property
    def knots(self) -> Array:
        """Times in s from the first sample."""
        return self.single.result.solver.knots * self.single.result.solver.slowness

    def sizes(self, u: Array) -> tuple[Array, Array]:
        """Energy-weighted mean of |log g| and |h| over the record, of draws (n, K): (n,) each."""
        g, h = self.deviations(u)
        one = self.single
        return size_of(one.weighing, one.result, g), size_of(one.weighing, one.result, h)

    def ratios(self, amplitudes: tuple[float, ...], u: Array) -> tuple[Ratio, ...]:
        """Equivalent damping ratios at amplitudes (rad or m), deviation and the sensor's floor among their sds."""
        drawn, rng = self._drawn(u), np.random.default_rng(1)
        return tuple(ratio_at(self.single.weighing, [drawn], a, self.sensor, rng) for a in amplitudes)

    def ratio_draws(self, amplitudes: Array, u: Array) -> Array:
        """The same as draws, (n, m); nan at amplitudes that no motion has."""
        drawn, rng = self._drawn(u), np.random.default_rng(1)
        found = [ratios_drawn(self.single.weighing, drawn, float(a), self.sensor, rng) for a in amplitudes]
        none = np.full(len(u), np.nan)
        return np.column_stack([none if one is None else one for one in found])

    def _drawn(self, u: Array) -> Drawn:
        result, solver = self.single.result, self.single.result.solver
        values = result.fit.parameters.values(u[:, : result.fit.z.size])
        m, law = len(solver.terms), solver.law_places
        return Drawn(result, values[:, :m], values[:, m : law.start], values[:, law], *self.deviations(u))

    def motions(self, u: Array, t: Array | None = None, quantity: str | None = None) -> Array:
        """Motions of draws (n, K) at times t (m,) in s within the knots, (n, m); nan where one escapes. By default at
        the samples that are fitted, in their quantity."""
        result, solver = self.single.result, self.single.result.solver
        if t is not None:
            solver = solver.at(np.asarray(t, float), quantity or solver.quantity)
        parameters = result.fit.parameters
        g, h = self.deviations(u)
        none = np.full(solver.t.size, np.nan)

        def one(i: int) -> Array:
            p = parameters.values(u[i, : parameters.free.size])
            found = solver.solve(p, result.fit.active, np.expm1(g[i]), h[i], NONE)
            return none if found is None else found.y

        assert solver.kernel  # compiled before several threads ask for it
        return np.stack(at_once(one, range(len(u)))) if len(u) else np.empty((0, none.size))

    @property
    def best(self) -> Array:
        """u of the best motion with its deviations, (1, K)."""
        about = self.single.result.about
        assert about is not None
        return about.u[None]

    def log_likelihoods(self, motions: Array) -> Array:
        """Log density of each sample of motions (..., n), in nats: with κ > 1 a sample counts for 1/κ of one, and its
        noise's variance is κ times larger, so that their sum is the log likelihood that was weighed."""
        weighing = self.single.weighing
        variance, kappa = weighing.variance, weighing.inflation
        left = np.asarray(weighing.data.y) - motions
        return -0.5 * left**2 / variance - 0.5 * np.log(2 * np.pi * variance) / kappa

    def prior_draws(self, count: int, seed: int) -> Array:
        """u under the prior, (n, K)."""
        result, rng = self.single.result, np.random.default_rng([seed, 1])
        parameters = result.fit.parameters
        grid = grid_of(self.knots.size, absorbed=parameters.absorbs)
        z = parameters.prior_draws(count, rng)
        mass = np.exp(grid.log_prior - grid.log_prior.max())
        combos = rng.choice(mass.size, count, p=mass / mass.sum())
        smooth = np.einsum(
            "nij,nj->ni", grid.factors[combos], rng.standard_normal((count, 2 * self.knots.size))
        )
        return np.concatenate([z, smooth], axis=1)
