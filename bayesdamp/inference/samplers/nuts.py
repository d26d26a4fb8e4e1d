"""The no-U-turn sampler, whitened at the mode, on the compiled kernel.

Its transition (M. D. Hoffman and A. Gelman, JMLR 15, 2014) moves between walls and chooses among the points of a
trajectory with multinomial probabilities (M. Betancourt, arXiv:1701.02434, 2017, appendix A.3).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from bayesdamp.inference.coordinates.whitening import Whitening, shear_of, whitening_of, whitening_under
from bayesdamp.inference.diagnostics import summarise, verdict
from bayesdamp.inference.mode import Mode
from bayesdamp.inference.model.likelihood import Likelihood, Line
from bayesdamp.inference.model.target import Target
from bayesdamp.inference.samplers._sampler import Sampler, Settings, Start, agreement, seeded_starts
from bayesdamp.types import OK, Posterior

DOUBLINGS = 7
"""A trajectory has at most 2⁷ steps."""
DIVERGED = 1000.0
"""Rise of the energy that ends a trajectory (conventional)."""
BOUNCES = 4
"""Bounces in one step, for each wall. A step with more bounces ends outside, where it is rejected."""
STEP = 1.05
"""Step in whitened coordinates: a little more than π/3, so that four points of a circle span half a turn, after which a
trajectory ends. A shorter step makes it twice as long for draws that are no better."""
POOR = 0.5
"""Mean acceptance below which steps or force are not good enough."""
DIVERGING = 0.002
"""Share of divergences above which they are not good enough; above 1 % the draws are not trusted."""
STEPS = (1.0, 0.5, 0.25, 0.125)
"""Shares of the usual step that are tried with the exact force."""
LONGEST = 3
"""Draws are added up to this many times the number that was asked for."""


@dataclass(frozen=True)
class Whitened:
    """A log density in whitened coordinates u, (d,), and the force that moves proposals.

    Attributes
    ----------
    likelihood : Likelihood
        Whose posterior it is.
    at : Whitening
        Maps coordinates to scores.
    line : Line or None
        The linearised motion that gives the force; None for the exact gradient.
    walls, offsets : ndarray, shapes (k, d) and (k,)
        walls @ u + offsets ≥ 0 inside.
    """

    likelihood: Likelihood
    at: Whitening
    line: Line | None
    walls: np.ndarray
    offsets: np.ndarray

    @classmethod
    def of(cls, mode: Mode, at: Whitening, exact: bool) -> Whitened:
        """Return the posterior of a mode's target; exact: whether the force is the exact gradient."""
        likelihood = mode.likelihood
        line = None if exact else likelihood.line(at.shear.scores(at.centre))
        reflected = likelihood.target.reflected
        return cls(likelihood, at, line, at.factor[reflected], at.centre[reflected])

    def height(self, u: np.ndarray) -> float:
        """Return the log density; −∞ where the motion escapes."""
        return self.likelihood.log_posterior(self.at.scores(u)) + float(self.at.log_volume(u))

    def slope(self, u: np.ndarray) -> np.ndarray:
        """Return the force, (d,)."""
        at, shear = self.at, self.at.shear
        away = at.factor @ u
        if self.line is None:
            straight = at.centre + away
            pull = self.likelihood.gradient(shear.scores(straight))[1] @ shear.slope(straight)
            pull = pull + shear.volume_slope(straight)
        else:
            # The linearised motion has a straight ridge: only the noise's map applies to it.
            level = shear.level(at.centre) + away
            along = self.likelihood.gradient_along(self.line, shear.noise.scores(level))
            pull = along @ shear.noise.slope(level) + shear.noise.volume_slope(level) - at.lacking @ away
        return pull @ at.factor


@dataclass(frozen=True)
class Point:
    """A point of a trajectory: position, momentum and force, (d,) each, and the log density."""

    u: np.ndarray
    p: np.ndarray
    slope: np.ndarray
    height: float

    @property
    def joint(self) -> float:
        """Log density of position and momentum."""
        return self.height - 0.5 * float(self.p @ self.p)


@dataclass
class _Subtree:
    """A part of a trajectory.

    Its ends in time, the point chosen from it, the log of the sum of its densities, the sum of its momenta, and whether
    it goes on.
    """

    first: Point
    last: Point
    chosen: Point
    weight: float
    momentum: np.ndarray
    goes_on: bool


class Chain:
    """A Markov chain in a space, with steps of one length."""

    def __init__(self, space: Whitened, step: float, rng: np.random.Generator) -> None:
        self.space, self.step, self.rng = space, step, rng

    def sampled(self, u: np.ndarray, height: float, count: int) -> tuple[np.ndarray, ...]:
        """Make `count` transitions from a start u, (d,), of this height.

        Returns positions (count, d), heights, divergences, steps and acceptance, (count,) each.
        """
        rows = []
        at = Point(u, np.zeros(u.size), self.space.slope(u), height)
        for _ in range(count):
            at, *rest = self.transition(at)
            rows.append((at.u, at.height, *rest))
        return tuple(map(np.array, zip(*rows, strict=True)))

    def transition(self, at: Point) -> tuple[Point, bool, int, float]:
        """Return the next point, whether the trajectory diverged, its steps, and its mean acceptance."""
        at = Point(at.u, self.rng.standard_normal(at.u.size), at.slope, at.height)
        self._begun, self._steps, self._accepted, self._diverged = at.joint, 0, 0.0, False
        tree = _Subtree(at, at, at, at.joint, at.p.copy(), True)
        for doubling in range(DOUBLINGS):
            ahead = bool(self.rng.random() < 0.5)
            new = self._build(tree.last if ahead else tree.first, 1 if ahead else -1, doubling)
            if not new.goes_on:
                break
            if np.log(self.rng.random()) < new.weight - tree.weight:
                tree.chosen = new.chosen
            tree = self._join(tree, new, ahead, tree.chosen)
            if not tree.goes_on:
                break
        return tree.chosen, self._diverged, self._steps, self._accepted / max(self._steps, 1)

    def _build(self, end: Point, way: int, depth: int) -> _Subtree:
        """Return 2^depth further points beyond an end of the trajectory; fewer where it does not go on."""
        if depth == 0:
            # A leapfrog step. The force need not be the density's gradient: each kick is a shear of the momenta in any
            # case.
            size = way * self.step
            u, p = drift(end.u, end.p + 0.5 * size * end.slope, size, self.space.walls, self.space.offsets)
            height = self.space.height(u) if np.all(np.isfinite(u)) else -np.inf
            slope = self.space.slope(u) if np.isfinite(height) else end.slope
            point = Point(u, p + 0.5 * size * slope, slope, height)
            joint = point.joint if np.isfinite(point.height) else -np.inf
            self._steps += 1
            self._accepted += float(np.exp(min(0.0, joint - self._begun)))
            diverged = not joint > self._begun - DIVERGED
            self._diverged = self._diverged or diverged
            return _Subtree(point, point, point, joint, point.p, not diverged)
        near = self._build(end, way, depth - 1)
        if not near.goes_on:
            return near
        far = self._build(near.last if way > 0 else near.first, way, depth - 1)
        if not far.goes_on:
            return far
        share = far.weight - np.logaddexp(near.weight, far.weight)
        chosen = far.chosen if np.log(self.rng.random()) < share else near.chosen
        return self._join(near, far, way > 0, chosen)

    @staticmethod
    def _join(tree: _Subtree, new: _Subtree, ahead: bool, chosen: Point) -> _Subtree:
        """Join two parts; the result goes on unless it, or its half about the join, turns round."""
        early, late = (tree, new) if ahead else (new, tree)
        momentum = early.momentum + late.momentum
        goes_on = (
            _apart(early.first, late.last, momentum)
            and _apart(early.first, late.first, early.momentum + late.first.p)
            and _apart(early.last, late.last, late.momentum + early.last.p)
        )
        weight = float(np.logaddexp(early.weight, late.weight))
        return _Subtree(early.first, late.last, chosen, weight, momentum, goes_on)


def _apart(first: Point, last: Point, momentum: np.ndarray) -> bool:
    """Return whether both ends still move away from each other."""
    return float(first.p @ momentum) > 0 and float(last.p @ momentum) > 0


def drift(
    u: np.ndarray, p: np.ndarray, time: float, walls: np.ndarray, offsets: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return position and momentum after a straight flight between walls.

    At a wall the momentum is mirrored. This is reversible and keeps volume, so that a leapfrog step made of it is as
    valid as one without walls (Afshar and Domke, NeurIPS 28, 2015).

    Parameters
    ----------
    u, p : ndarray, shape (d,)
        Position and momentum at the start.
    time : float
        Duration of the flight, which may be negative.
    walls, offsets : ndarray, shapes (k, d) and (k,)
        walls @ u + offsets ≥ 0 inside.

    Returns
    -------
    u, p : ndarray, shape (d,)
        The position is not a number after more than `BOUNCES` bounces for each wall.
    """
    straight = u + time * p
    if np.all(walls @ straight + offsets >= 0.0):  # no wall between two points inside
        return straight, p
    towards = 1.0 if time >= 0 else -1.0
    v, left = towards * p, abs(time)
    for _ in range(BOUNCES * len(walls) + 1):
        closing = -(walls @ v)
        distance = np.maximum(walls @ u + offsets, 0.0)
        reach = np.where(closing > 0, distance / np.where(closing > 0, closing, 1.0), np.inf)
        first = int(np.argmin(reach))
        if reach[first] >= left:
            return u + left * v, towards * v
        u = u + reach[first] * v
        left -= float(reach[first])
        normal = walls[first] / np.linalg.norm(walls[first])
        v = v - 2.0 * (normal @ v) * normal
    return np.full_like(u, np.nan), towards * v


def poor(posterior: Posterior) -> bool:
    """Return whether steps or force were not good enough: too many rejections or divergences."""
    rejected = float(np.mean(posterior.stats["acceptance_rate"])) < POOR
    return rejected or float(np.mean(posterior.stats["diverging"])) > DIVERGING


@dataclass(frozen=True)
class ChainRun:
    """The chains of one record.

    Attributes
    ----------
    at : Whitening
        Coordinates of the chains.
    exact : bool
        Whether the force is the exact gradient.
    warmup : int
        Draws of each chain that are discarded.
    starts : list of Start
        Where each chain started.
    chains : list of Chain
        The chains.
    left : tuple of ndarray
        Positions (chain, warm-up and draw, d), heights, divergences, steps and acceptance, (chain, warm-up and draw).
    """

    at: Whitening
    exact: bool
    warmup: int
    starts: list[Start]
    chains: list[Chain]
    left: tuple[np.ndarray, ...]

    @property
    def draws(self) -> int:
        """Number of draws of each chain after the warm-up."""
        return self.left[0].shape[1] - self.warmup

    def posterior(self, mode: Mode) -> Posterior:
        """Return the draws after the warm-up, with their diagnostics."""
        target = mode.likelihood.target
        u, height, diverging, steps, accept = (x[:, self.warmup :] for x in self.left)
        z = self.at.scores(u)
        values = target.values(z)
        summaries = {n: summarise(v) for n, v in values.items()}
        divergences = int(np.sum(diverging))
        outcome = verdict(summaries)
        if outcome == OK and divergences > 0.01 * diverging.size:
            outcome = f"{divergences} of {diverging.size} transitions diverged"
        draws = np.stack(list(values.values()), axis=-1)
        return Posterior(
            sampler=Nuts.name,
            names=target.names,
            draws=draws,
            log_likelihood=height - self.at.log_volume(u) - mode.likelihood.log_prior(z),
            stats={"diverging": diverging, "n_steps": steps, "acceptance_rate": accept},
            diagnostics={"exact_force": self.exact, "step": self.chains[0].step},
            outcome=outcome,
            summaries=summaries,
            starts=agreement(self.starts, draws),
            divergences=divergences,
            evaluations=int(np.sum(steps)),
        )

    def longer(self, count: int) -> ChainRun:
        """Return the run with count more draws of each chain, from where it ended."""
        more = [
            chain.sampled(u[-1], float(height[-1]), count)
            for chain, u, height in zip(self.chains, *self.left[:2], strict=True)
        ]
        added = zip(self.left, zip(*more, strict=True), strict=True)
        return replace(self, left=tuple(np.concatenate([x, np.stack(y)], axis=1) for x, y in added))


class MixtureChain(Chain):
    """A chain in a posterior that is a mixture over hyperparameters of deviations.

    It draws a combination of these given the position, then a position given the combination (Gibbs sampling). One
    component may be many times narrower than another, so that no single step suits both.

    Attributes
    ----------
    mode : Mode
        Mode of the posterior.
    whole : Whitened
        Coordinates of the positions that the chain returns.
    given : dict of int to Whitened
        The posterior given each combination that was drawn, in coordinates of its own; chains share it.
    """

    def __init__(
        self, mode: Mode, whole: Whitened, given: dict[int, Whitened], step: float, rng: np.random.Generator
    ) -> None:
        super().__init__(whole, step, rng)
        self.mode, self.whole, self.given = mode, whole, given

    def under(self, combination: int) -> Whitened:
        """Return the posterior given a combination."""
        if combination not in self.given:
            at = whitening_under(self.mode, combination, self.whole.at.shear)
            conditional = replace(self.mode, likelihood=self.mode.likelihood.under(combination))
            self.given[combination] = Whitened.of(conditional, at, self.whole.line is None)
        return self.given[combination]

    def sampled(self, u: np.ndarray, height: float, count: int) -> tuple[np.ndarray, ...]:
        """Make transitions as `Chain.sampled` does; positions and heights are those of the whole mixture."""
        likelihood, left = self.mode.likelihood, []
        assert likelihood.target.deviation is not None
        z = self.whole.at.scores(u)
        residual, prior = likelihood.residual(z), float(likelihood.log_prior(z))
        for _ in range(count):
            self.space = self.under(likelihood.target.deviation.combination_given(residual, self.rng))
            u = self.space.at.whitened(z[None])[0]
            height = prior + self.space.likelihood.log_noise(residual, z)
            at, *rest = self.transition(Point(u, u, self.space.slope(u), height))
            z = self.space.at.scores(at.u)
            residual, prior = likelihood.residual(z), float(likelihood.log_prior(z))
            height = prior + likelihood.log_noise(residual, z)
            left.append((self.whole.at.whitened(z[None])[0], height, *rest))
        return tuple(map(np.array, zip(*left, strict=True)))


class Nuts(Sampler):
    """Hoffman and Gelman's NUTS (JMLR 15, 2014) in whitened coordinates that end where a damping is zero.

    Energies, which decide on acceptance, are exact. The force that moves a proposal may be any function of the position
    (leapfrog steps stay reversible and keep volume). It is that of the linearised motion, which needs no tangents. The
    step follows from the whole curvature. Draws are added where they are too few. Where that does not help, or
    proposals are rejected, sampling is repeated with a curved ridge straightened, with shorter steps, and with the
    exact gradient.
    """

    name = "nuts"

    def sample(self, target: Target, mode: Mode, settings: Settings) -> Posterior:
        """Run chains from near the mode, longer or again with other steps where they are not good enough."""
        at = whitening_of(target, mode)
        run, posterior = self._extend(mode, settings, self.attempt(mode, at, settings, not at.good))
        if posterior.outcome != OK or poor(posterior):
            ridge = shear_of(target, mode)
            if ridge is not None:
                at = whitening_of(target, mode, ridge)
                run, posterior = self._extend(mode, settings, self.attempt(mode, at, settings, not at.good))
        # Where the posterior has edges, shorter steps help the cheap force too; so the exact force comes after them.
        others = [(True, share) for share in STEPS]
        for exact, shorter in others[1:] if run.exact else [(False, 0.5), *others]:
            if not poor(posterior):
                break
            again = self.attempt(mode, run.at, settings, exact, shorter)
            run, posterior = self._extend(mode, settings, again)
        return posterior

    def attempt(
        self, mode: Mode, at: Whitening, settings: Settings, exact: bool = False, shorter: float = 1.0
    ) -> ChainRun:
        """Run chains of the length that was asked for.

        Parameters
        ----------
        mode : Mode
            Of the posterior.
        at : Whitening
            Its coordinates.
        settings : Settings
            Chains, draws and seed.
        exact : bool
            Whether the force is the exact gradient.
        shorter : float
            Share of the usual step.
        """
        target, warmup = mode.likelihood.target, settings.warmup_of(mode)
        u, heights, starts = seeded_starts(target, mode, at, settings.chains, settings)
        space, step, given = Whitened.of(mode, at, exact), shorter * STEP, dict[int, Whitened]()
        chains = [
            Chain(space, step, rng)
            if target.deviation is None
            else MixtureChain(mode, space, given, step, rng)
            for rng in (np.random.default_rng([settings.seed, i]) for i in range(settings.chains))
        ]
        left = [
            chain.sampled(start, float(height), warmup + settings.draws)
            for chain, start, height in zip(chains, u, heights, strict=True)
        ]
        return ChainRun(at, exact, warmup, starts, chains, tuple(map(np.stack, zip(*left, strict=True))))

    def _extend(self, mode: Mode, settings: Settings, run: ChainRun) -> tuple[ChainRun, Posterior]:
        """Add draws while they are too few and more might suffice; return the run and its posterior."""
        posterior, count = run.posterior(mode), run.left[0].shape[1]
        most = LONGEST * settings.draws if settings.grows else settings.draws
        while posterior.outcome != OK and not poor(posterior) and run.draws < most:
            run = run.longer(count)
            posterior = run.posterior(mode)
        return run, posterior


PLUGIN = Nuts()
