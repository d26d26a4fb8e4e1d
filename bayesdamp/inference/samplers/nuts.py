"""The no-U-turn sampler in coordinates that are whitened at the mode, in which the posterior is nearly standard normal.

The transition is that of M. D. Hoffman and A. Gelman (JMLR 15, 2014), with multinomial sampling among the points of a
trajectory (M. Betancourt, arXiv:1701.02434, 2017, appendix A.3). Trajectories are reflected at walls, which are the
bounds where a coefficient is zero.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from bayesdamp.inference.coordinates import (
    Whitening,
    shear_of,
    slope_along,
    slope_at,
    whitening_of,
    whitening_under,
)
from bayesdamp.inference.diagnostics import summarise, verdict
from bayesdamp.inference.mode import Mode
from bayesdamp.inference.model.likelihood import Likelihood, Line
from bayesdamp.inference.model.target import Target
from bayesdamp.inference.samplers._sampler import Sampler, Settings, seeded_starts
from bayesdamp.types import OK, Posterior

MOST_DOUBLINGS = 7
"""Greatest number of times that NUTS doubles a trajectory, which then has at most 2⁷ points."""
DIVERGENCE_NATS = 1000.0
"""A NUTS trajectory counts as divergent if its energy increases by at least this many nats, or is infinite as for an
unbounded motion (conventional)."""
MOST_REFLECTIONS = 4
"""Greatest number of reflections in a leapfrog step for each wall (a bound where a coefficient is zero), 4 k in total
for k walls; a step with more is rejected."""
LEAPFROG_STEP = 1.05
"""Length of a leapfrog step in whitened coordinates, in which the posterior is nearly standard normal and trajectories
are nearly circles with a period of 2π. With slightly more than π/3, four points span half of a circle, after which a
trajectory turns back and ends. Shorter steps make trajectories twice as long, and the draws are not better."""
LEAST_ACCEPTANCE = 0.5
"""If the mean acceptance probability of NUTS is below this, sampling is repeated: in coordinates in which a curved
posterior is straight (`Shear`), with shorter steps, or with the exact gradient (conventional)."""
MOST_DIVERGENT = 0.002
"""If a larger fraction than this of the NUTS transitions diverges, sampling is repeated as for `LEAST_ACCEPTANCE`. The
outcome reports divergences only above 1 %."""
ATTEMPTS = ((False, 0.5), (True, 1.0), (True, 0.5), (True, 0.25), (True, 0.125))
"""Repetitions of NUTS sampling that are tried in turn while the draws are poor (`is_poor`). Each is a pair: True if the
force of the leapfrog steps is the exact gradient, False if it is that for the linearised motion; and the factor by
which `LEAPFROG_STEP` is multiplied. If the force was the exact gradient already, the first two are left out
(conventional)."""
MOST_DRAWS_FACTOR = 3
"""NUTS continues its chains if they have not converged or the effective number of draws is too small: until this is no
longer so, or until each chain has at least this multiple of the requested number of draws."""


@dataclass(frozen=True)
class WhitenedPosterior:
    """The log posterior density in whitened coordinates u, (d,), and the force of the leapfrog steps in them.

    The force is the gradient of the log density by u, exact or for a linearised motion.

    Attributes
    ----------
    likelihood : Likelihood
        The likelihood with its target.
    at : Whitening
        Map from the coordinates u to scores.
    line : Line or None
        The linearised motion from which the force is computed; None for the exact gradient.
    walls, offsets : ndarray, shapes (k, d) and (k,)
        The k bounds where a coefficient is zero: the posterior is limited to walls @ u + offsets ≥ 0.
    """

    likelihood: Likelihood
    at: Whitening
    line: Line | None
    walls: np.ndarray
    offsets: np.ndarray

    @classmethod
    def of(cls, mode: Mode, at: Whitening, exact: bool) -> WhitenedPosterior:
        """Return the posterior density in the whitened coordinates of `at`.

        exact: True if the force of the leapfrog steps is the exact gradient; False if it is the gradient for the motion
        linearised at the centre of `at`, which is faster.
        """
        likelihood = mode.likelihood
        line = None if exact else likelihood.line(at.shear.scores(at.centre))
        reflected = likelihood.target.reflected
        return cls(likelihood, at, line, at.factor[reflected], at.centre[reflected])

    def log_density(self, u: np.ndarray) -> float:
        """Return the log posterior density (nats) at u, (d,), up to a constant; −∞ if the motion is unbounded.

        The walls are not considered: beyond them the density is continued symmetrically.
        """
        return self.likelihood.log_posterior(self.at.scores(u)) + float(self.at.log_volume(u))

    def force(self, u: np.ndarray) -> np.ndarray:
        """Return the gradient of the log density by u, (d,), at u, (d,): exact, or for the linearised motion.

        The gradient for the linearised motion is corrected by the curvature that this motion lacks
        (`Whitening.lacking`).
        """
        at, shear, away = self.at, self.at.shear, self.at.factor @ u
        if self.line is None:
            return slope_at(self.likelihood, shear, at.centre + away) @ at.factor
        along = slope_along(self.likelihood, self.line, shear.noise, shear.level(at.centre) + away)
        return (along - at.lacking @ away) @ at.factor


@dataclass(frozen=True)
class Point:
    """A point of a NUTS trajectory: position u, momentum p and force, (d,) each, and the log density (nats) at u.

    The force is the gradient of the log density at u, exact or approximate.
    """

    u: np.ndarray
    p: np.ndarray
    force: np.ndarray
    log_density: float

    @property
    def joint(self) -> float:
        """Log density (nats) of position and momentum, up to a constant: that of the position minus |p|²/2."""
        return self.log_density - 0.5 * float(self.p @ self.p)


@dataclass
class _Subtree:
    """A part of a NUTS trajectory: a sequence of points, made by leapfrog steps.

    first, last: its first and last point in time. chosen: the point that was drawn from its points. weight: log of the
    sum of the densities of position and momentum over its points. momentum: sum of the momenta of its points, (d,).
    goes_on: False if it has diverged or turned back, so that the trajectory ends.
    """

    first: Point
    last: Point
    chosen: Point
    weight: float
    momentum: np.ndarray
    goes_on: bool


class Chain:
    """A Markov chain that the no-U-turn sampler (NUTS) generates with a fixed leapfrog step.

    The step is never adapted, and warm-up draws are made like all others: the caller discards them. The starting point
    is an argument of `sample`.

    space: the posterior in whitened coordinates. step: length of a leapfrog step in them. rng: random generator.
    """

    def __init__(self, space: WhitenedPosterior, step: float, rng: np.random.Generator) -> None:
        self.space, self.step, self.rng = space, step, rng

    def sample(self, u: np.ndarray, log_density: float, count: int) -> tuple[np.ndarray, ...]:
        """Make `count` draws by NUTS, starting from position u, (d,).

        u itself is not a draw, and no draw is discarded as warm-up. log_density: log density at u (nats), as from
        `space.log_density`. Returns, for each draw: position (count, d), log density, whether its trajectory diverged,
        number of leapfrog steps, and mean acceptance probability, (count,) each.
        """
        rows = []
        at = Point(u, np.zeros(u.size), self.space.force(u), log_density)
        for _ in range(count):
            at, *rest = self.transition(at)
            rows.append((at.u, at.log_density, *rest))
        return tuple(map(np.array, zip(*rows, strict=True)))

    def transition(self, at: Point) -> tuple[Point, bool, int, float]:
        """Make one transition of NUTS from the point `at`, whose momentum is replaced by a random one.

        Returns four values: the next point; whether the trajectory diverged; its number of leapfrog steps; and the
        acceptance, which is the mean over the points of the trajectory of the probability of accepting each.
        """
        at = Point(at.u, self.rng.standard_normal(at.u.size), at.force, at.log_density)
        self._initial_joint, self._steps, self._accepted, self._diverged = at.joint, 0, 0.0, False
        tree = _Subtree(at, at, at, at.joint, at.p.copy(), True)
        for doubling in range(MOST_DOUBLINGS):
            forwards = bool(self.rng.random() < 0.5)
            new = self._build(tree.last if forwards else tree.first, 1 if forwards else -1, doubling)
            if not new.goes_on:
                break
            if np.log(self.rng.random()) < new.weight - tree.weight:
                tree.chosen = new.chosen
            tree = self._join(tree, new, forwards, tree.chosen)
            if not tree.goes_on:
                break
        return tree.chosen, self._diverged, self._steps, self._accepted / max(self._steps, 1)

    def _build(self, end: Point, direction: int, depth: int) -> _Subtree:
        """Extend a trajectory by 2^depth points beyond its point `end`; return the new part.

        direction: 1 forwards in time, −1 backwards. The new part is shorter if it turns back or diverges.
        """
        if depth == 0:
            # A leapfrog step. Any function of the position may serve as the force: the step is reversible and preserves
            # volume in any case.
            size = direction * self.step
            u, p = drift(end.u, end.p + 0.5 * size * end.force, size, self.space.walls, self.space.offsets)
            log_density = self.space.log_density(u) if np.all(np.isfinite(u)) else -np.inf
            force = self.space.force(u) if np.isfinite(log_density) else end.force
            point = Point(u, p + 0.5 * size * force, force, log_density)
            joint = point.joint if np.isfinite(log_density) else -np.inf
            self._steps += 1
            self._accepted += float(np.exp(min(0.0, joint - self._initial_joint)))
            diverged = not joint > self._initial_joint - DIVERGENCE_NATS
            self._diverged = self._diverged or diverged
            return _Subtree(point, point, point, joint, point.p, not diverged)
        near = self._build(end, direction, depth - 1)
        if not near.goes_on:
            return near
        far = self._build(near.last if direction > 0 else near.first, direction, depth - 1)
        if not far.goes_on:
            return far
        log_probability = far.weight - np.logaddexp(near.weight, far.weight)
        chosen = far.chosen if np.log(self.rng.random()) < log_probability else near.chosen
        return self._join(near, far, direction > 0, chosen)

    @staticmethod
    def _join(tree: _Subtree, new: _Subtree, forwards: bool, chosen: Point) -> _Subtree:
        """Join two adjacent parts of a trajectory.

        forwards: True if `new` is later than `tree`, False if it is earlier. chosen: the point that was drawn from both
        parts together. The trajectory ends (`goes_on` is False) if the result, or one of its parts together with the
        nearest point of the other, turns back (U-turn criterion).
        """
        early, late = (tree, new) if forwards else (new, tree)
        momentum = early.momentum + late.momentum
        goes_on = (
            _ends_move_apart(early.first, late.last, momentum)
            and _ends_move_apart(early.first, late.first, early.momentum + late.first.p)
            and _ends_move_apart(early.last, late.last, late.momentum + early.last.p)
        )
        weight = float(np.logaddexp(early.weight, late.weight))
        return _Subtree(early.first, late.last, chosen, weight, momentum, goes_on)


def _ends_move_apart(first: Point, last: Point, momentum: np.ndarray) -> bool:
    """Return whether both ends of a part of a trajectory still move away from each other.

    They do if the momenta at both have positive products with `momentum`, the sum of the momenta of all points from
    first to last.
    """
    return float(first.p @ momentum) > 0 and float(last.p @ momentum) > 0


def drift(
    u: np.ndarray, p: np.ndarray, time: float, walls: np.ndarray, offsets: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Move a point along a straight line that is reflected at walls; return its new position and momentum.

    Reflection is reversible and preserves volume, so leapfrog steps with it are valid (Afshar and Domke, NeurIPS 28,
    2015).

    Parameters
    ----------
    u, p : ndarray, shape (d,)
        Position and momentum at the start. The velocity is equal to the momentum.
    time : float
        Duration of the motion, which may be negative.
    walls, offsets : ndarray, shapes (k, d) and (k,)
        The k walls: the motion is limited to walls @ u + offsets ≥ 0.

    Returns
    -------
    u, p : ndarray, shape (d,)
        Position and momentum at the end. The position is nan after more than `MOST_REFLECTIONS` · k reflections.
    """
    straight = u + time * p
    if np.all(walls @ straight + offsets >= 0.0):  # both points are inside, and the support is convex
        return straight, p
    towards = 1.0 if time >= 0 else -1.0
    v, remaining = towards * p, abs(time)
    for _ in range(MOST_REFLECTIONS * len(walls) + 1):
        closing = -(walls @ v)
        distance = np.maximum(walls @ u + offsets, 0.0)
        reach = np.where(closing > 0, distance / np.where(closing > 0, closing, 1.0), np.inf)
        first = int(np.argmin(reach))
        if reach[first] >= remaining:
            return u + remaining * v, towards * v
        u = u + reach[first] * v
        remaining -= float(reach[first])
        normal = walls[first] / np.linalg.norm(walls[first])
        v = v - 2.0 * (normal @ v) * normal
    return np.full_like(u, np.nan), towards * v


def is_poor(posterior: Posterior) -> bool:
    """Return whether NUTS rejected too many proposals, or too many of its transitions diverged.

    This is so if the mean acceptance probability is below `LEAST_ACCEPTANCE`, or the fraction of divergent transitions
    above `MOST_DIVERGENT`. posterior: result of NUTS. Convergence and the number of draws are not considered.
    """
    rejected = float(np.mean(posterior.stats["acceptance_rate"])) < LEAST_ACCEPTANCE
    return rejected or float(np.mean(posterior.stats["diverging"])) > MOST_DIVERGENT


@dataclass(frozen=True)
class ChainRun:
    """Chains of NUTS with the same leapfrog step and kind of force, and their draws.

    Attributes
    ----------
    at : Whitening
        Map from the whitened coordinates of the chains to standard normal scores of the parameters.
    exact : bool
        True if the force of the leapfrog steps is the exact gradient, False if it is that for the linearised motion.
    warmup : int
        Number of first draws of each chain that are discarded.
    chains : list of Chain
        The chains.
    results : tuple of ndarray
        The draws of all chains, warm-up included: positions (chain, draw, d), and for each draw log density, whether
        its trajectory diverged, number of leapfrog steps and acceptance probability, (chain, draw) each.
    """

    at: Whitening
    exact: bool
    warmup: int
    chains: list[Chain]
    results: tuple[np.ndarray, ...]

    @property
    def draws(self) -> int:
        """Number of draws of each chain after the warm-up (not of all chains together)."""
        return self.results[0].shape[1] - self.warmup

    def posterior(self, mode: Mode) -> Posterior:
        """Return the posterior of the parameters from the draws after the warm-up, with diagnostics of the chains.

        Its outcome is "ok", or says which parameter is not reliable (`verdict`) or that more than 1 % of transitions
        diverged.
        """
        target = mode.likelihood.target
        u, log_density, diverging, steps, accept = (x[:, self.warmup :] for x in self.results)
        z = self.at.scores(u)
        values = target.values(z)
        summaries = {n: summarise(v) for n, v in values.items()}
        divergences = int(np.sum(diverging))
        outcome = verdict(summaries)
        if outcome == OK and divergences > 0.01 * diverging.size:
            outcome = f"{divergences} of {diverging.size} transitions diverged"
        return Posterior(
            sampler=Nuts.name,
            names=target.names,
            draws=np.stack(list(values.values()), axis=-1),
            log_likelihood=log_density - self.at.log_volume(u) - mode.likelihood.log_prior(z),
            stats={"diverging": diverging, "n_steps": steps, "acceptance_rate": accept},
            diagnostics={"exact_force": self.exact, "step": self.chains[0].step},
            outcome=outcome,
            summaries=summaries,
            divergences=divergences,
            evaluations=int(np.sum(steps)),
        )

    def continue_chains(self, count: int) -> ChainRun:
        """Return a run with the earlier draws and `count` more of each chain, which continue from its last draw."""
        ends = zip(self.chains, *self.results[:2], strict=True)
        more = [chain.sample(u[-1], float(log_density[-1]), count) for chain, u, log_density in ends]
        added = zip(self.results, zip(*more, strict=True), strict=True)
        return replace(self, results=tuple(np.concatenate([x, np.stack(y)], axis=1) for x, y in added))


class MixtureChain(Chain):
    """A chain of NUTS in a posterior that is a mixture over hyperparameters.

    The hyperparameters are the sizes (prior sds) and correlation lengths of the deviations from the laws. The chain
    alternately draws a combination of them given the position, and a position given the combination (Gibbs sampling),
    because the components of the mixture can have very different widths.

    Attributes
    ----------
    mode : Mode
        Mode of the posterior.
    whole : WhitenedPosterior
        The whole mixture; `sample` takes and returns positions in its coordinates.
    given : dict of int to WhitenedPosterior
        Cache that all chains share: the posterior given a combination, with its own coordinates, by index of the
        combination.
    """

    def __init__(
        self,
        mode: Mode,
        whole: WhitenedPosterior,
        given: dict[int, WhitenedPosterior],
        step: float,
        rng: np.random.Generator,
    ) -> None:
        super().__init__(whole, step, rng)
        self.mode, self.whole, self.given = mode, whole, given

    def under(self, combination: int) -> WhitenedPosterior:
        """Return the posterior given the combination of hyperparameters with this index; the result is cached."""
        if combination not in self.given:
            at = whitening_under(self.mode, combination, self.whole.at.shear)
            conditional = replace(self.mode, likelihood=self.mode.likelihood.under(combination))
            self.given[combination] = WhitenedPosterior.of(conditional, at, self.whole.line is None)
        return self.given[combination]

    def sample(self, u: np.ndarray, log_density: float, count: int) -> tuple[np.ndarray, ...]:
        """Make `count` draws by NUTS from position u, with a new combination of hyperparameters before each draw.

        The combination is drawn given the position. Positions, in the argument and in the result, are in the
        coordinates of the whole mixture, and the log densities in the result are those of the mixture. The argument
        `log_density` has no effect. Returns, for each draw: position (count, d), log density, whether its trajectory
        diverged, number of leapfrog steps, and mean acceptance probability, (count,) each.
        """
        likelihood, rows = self.mode.likelihood, []
        assert likelihood.target.deviation is not None
        z = self.whole.at.scores(u)
        residual, prior = likelihood.residual(z), float(likelihood.log_prior(z))
        for _ in range(count):
            self.space = self.under(likelihood.target.deviation.combination_given(residual, self.rng))
            u = self.space.at.whitened(z[None])[0]
            log_density = prior + self.space.likelihood.log_noise(residual, z)
            at, *rest = self.transition(Point(u, u, self.space.force(u), log_density))
            z = self.space.at.scores(at.u)
            residual, prior = likelihood.residual(z), float(likelihood.log_prior(z))
            log_density = prior + likelihood.log_noise(residual, z)
            rows.append((self.whole.at.whitened(z[None])[0], log_density, *rest))
        return tuple(map(np.array, zip(*rows, strict=True)))


class Nuts(Sampler):
    """The no-U-turn sampler (Hoffman and Gelman, JMLR 15, 2014) in whitened coordinates.

    Coefficients are bounded at zero. The force of the leapfrog steps is the gradient for the linearised motion, which
    is cheap. The draws are nevertheless from the exact posterior: acceptance is decided by exact energies, and any
    function of the position is valid as a force. If the chains have not converged or there are too few effective draws,
    they are continued. If that does not help, or if the draws are poor (`is_poor`), sampling is repeated in coordinates
    in which a curved posterior is straight (`Shear`); and as long as the draws are poor, with shorter steps or the
    exact gradient (`ATTEMPTS`).
    """

    def sample(self, target: Target, mode: Mode, settings: Settings) -> Posterior:
        """Return draws from chains that start near the mode; continue or repeat chains that are not good enough.

        The chains start at the points of `seeded_starts`. If no run is good enough, the last one is returned. Its
        outcome reports poor convergence and more than 1 % divergences, but not a low acceptance. Only the draws of one
        run, after its warm-up, are returned.
        """
        at = whitening_of(target, mode)
        run, posterior = self._run(mode, at, settings, not at.good)
        if (posterior.outcome != OK or is_poor(posterior)) and (ridge := shear_of(target, mode)) is not None:
            at = whitening_of(target, mode, ridge)
            run, posterior = self._run(mode, at, settings, not at.good)
        # Shorter steps can help with the cheap force too, so they are tried before the exact gradient.
        for exact, factor in ATTEMPTS[2:] if run.exact else ATTEMPTS:
            if not is_poor(posterior):
                break
            run, posterior = self._run(mode, at, settings, exact, factor)
        return posterior

    def run_chains(
        self, mode: Mode, at: Whitening, settings: Settings, exact: bool = False, factor: float = 1.0
    ) -> ChainRun:
        """Run chains with the requested numbers of warm-up and other draws, and a given kind of force and step.

        Parameters
        ----------
        mode : Mode
            Mode of the posterior.
        at : Whitening
            Map from the coordinates of the chains to scores.
        settings : Settings
            Numbers of chains, of warm-up and of other draws, and the seed.
        exact : bool
            True if the force of the leapfrog steps is the exact gradient; False if it is the gradient for the motion
            linearised at the centre of `at`.
        factor : float
            Length of the leapfrog step, as a multiple of `LEAPFROG_STEP`.

        Returns
        -------
        ChainRun
            The chains with their draws.
        """
        target, warmup = mode.likelihood.target, settings.warmup_of(mode)
        u, log_densities = seeded_starts(target, mode, at, settings.chains, settings)
        space, step = WhitenedPosterior.of(mode, at, exact), factor * LEAPFROG_STEP
        rngs = [np.random.default_rng([settings.seed, i]) for i in range(settings.chains)]
        chains: list[Chain] = [Chain(space, step, rng) for rng in rngs]
        if target.deviation is not None:
            given: dict[int, WhitenedPosterior] = {}
            chains = [MixtureChain(mode, space, given, step, rng) for rng in rngs]
        starts = zip(chains, u, log_densities, strict=True)
        results = [chain.sample(x, float(log), warmup + settings.draws) for chain, x, log in starts]
        return ChainRun(at, exact, warmup, chains, tuple(map(np.stack, zip(*results, strict=True))))

    def _run(
        self, mode: Mode, at: Whitening, settings: Settings, exact: bool, factor: float = 1.0
    ) -> tuple[ChainRun, Posterior]:
        """Run chains as `run_chains` does, and continue them while their draws are too few but not poor.

        Draws are too few if the outcome of the posterior is not "ok". They are poor if too many proposals are rejected
        or too many transitions diverge (`is_poor`). If `settings.grows` is True, chains are continued up to about
        `MOST_DRAWS_FACTOR` times the requested number of draws; otherwise they are not continued. Returns the run and
        its posterior.
        """
        run = self.run_chains(mode, at, settings, exact, factor)
        posterior, count = run.posterior(mode), run.results[0].shape[1]
        most = MOST_DRAWS_FACTOR * settings.draws if settings.grows else settings.draws
        while posterior.outcome != OK and not is_poor(posterior) and run.draws < most:
            run = run.continue_chains(count)
            posterior = run.posterior(mode)
        return run, posterior


PLUGIN = Nuts()
