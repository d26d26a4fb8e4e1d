"""The no-U-turn sampler, whitened at the mode, on the compiled kernel."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from bayesdamp.inference.checks import diagnostics
from bayesdamp.inference.coordinates.shear import shear_of
from bayesdamp.inference.coordinates.whitening import Whitening, whitening_of, whitening_under
from bayesdamp.inference.fit.mode import Mode
from bayesdamp.inference.model.target import Target
from bayesdamp.inference.samplers._no_u_turn import Chain, Point, Whitened
from bayesdamp.inference.samplers._sampler import Sampler, Settings
from bayesdamp.inference.samplers._starts import Start, agreement, seeded_starts
from bayesdamp.types import OK, Posterior

STEP = 1.05
"""Step in whitened coordinates: a little more than π/3, so that four points of a circle span half a turn, behind which
a trajectory ends. A shorter step makes it twice as long for draws that are no better."""
POOR = 0.5
"""Mean acceptance below which the force is no good."""
DIVERGING = 0.002
"""And the share of divergences above which; a fifth of that from which the draws are not trusted."""
STEPS = (1.0, 0.5, 0.25, 0.125)
"""Shares of the usual step that the exact force is tried with."""
LONGEST = 3
"""Times the draws that were asked for, from which on none are added."""


def poor(found: Posterior) -> bool:
    """Whether steps or force were not good enough: refusals or divergences."""
    refused = float(np.mean(found.stats["acceptance_rate"])) < POOR
    return refused or float(np.mean(found.stats["diverging"])) > DIVERGING


@dataclass(frozen=True)
class Run:
    """The chains of one record, and what they left.

    left: positions (chain, warm-up and draw, d), heights, divergences, steps and acceptance, (chain, warm-up and draw).
    """

    at: Whitening
    exact: bool
    warmup: int
    begun: list[Start]
    chains: list[Chain]
    left: tuple[np.ndarray, ...]

    @property
    def draws(self) -> int:
        """How many of each chain are kept, without the warm-up."""
        return self.left[0].shape[1] - self.warmup

    def posterior(self, mode: Mode) -> Posterior:
        """Return the draws after the warm-up, with their diagnostics."""
        target = mode.likelihood.target
        u, height, diverging, steps, accept = (x[:, self.warmup :] for x in self.left)
        z = self.at.scores(u)
        values = target.values(z)
        summaries = {n: diagnostics.summarise(v) for n, v in values.items()}
        divergences = int(np.sum(diverging))
        outcome = diagnostics.verdict(summaries)
        if outcome == OK and divergences > 0.01 * diverging.size:
            outcome = f"{divergences} of {diverging.size} transitions diverged"
        draws = np.stack(list(values.values()), axis=-1)
        return Posterior(
            sampler=Nuts.name,
            names=target.names,
            draws=draws,
            log_likelihood=height - mode.likelihood.log_prior(z),
            stats={"diverging": diverging, "n_steps": steps, "acceptance_rate": accept},
            diagnostics={"exact_force": self.exact, "step": self.chains[0].step},
            outcome=outcome,
            summaries=summaries,
            starts=agreement(self.begun, draws),
            divergences=divergences,
            evaluations=int(np.sum(steps)),
        )

    def longer(self, count: int) -> Run:
        """Return the same with count more draws of each chain, from where it ended."""
        more = [
            chain.sampled(u[-1], float(height[-1]), count)
            for chain, u, height in zip(self.chains, *self.left[:2], strict=True)
        ]
        whole = tuple(
            np.concatenate([x, np.stack(y)], axis=1)
            for x, y in zip(self.left, zip(*more, strict=True), strict=True)
        )
        return replace(self, left=whole)


class MixtureChain(Chain):
    """A chain in a posterior that is a mixture over hyperparameters of deviations.

    A combination of these is drawn given the position, then a position given the combination (Gibbs sampling). One
    component may be many times narrower than another, so that no step suits both.

    Attributes
    ----------
    mode : Mode
        The posterior's.
    whole : Whitened
        The coordinates of positions that the chain leaves.
    given : dict of int to Whitened
        The posterior given a combination, in coordinates of its own, as far as it was asked for; chains share it.
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
            held = replace(self.mode, likelihood=self.mode.likelihood.under(combination))
            self.given[combination] = Whitened.of(held, at, self.whole.line is None)
        return self.given[combination]

    def sampled(self, u: np.ndarray, height: float, count: int) -> tuple[np.ndarray, ...]:
        """Return what `Chain.sampled` does; positions and heights are those of the whole mixture."""
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

    Energies, which decide on acceptance, are exact. The force that moves a proposal may be any function of
    the position (leapfrog steps stay reversible and keep volume), so it is that of the linearised
    trajectory, which costs no tangents. With the whole curvature known the step is too. Draws that are
    too few are added to; where that does not help, or proposals are refused, they are taken again with a curved
    ridge straightened, with shorter steps, and with the exact gradient.
    """

    name = "nuts"

    def sample(self, target: Target, mode: Mode, settings: Settings) -> Posterior:
        """Chains from the mode's neighbourhood, longer or again with other steps where they are not good enough."""
        at = whitening_of(target, mode)
        run, found = self._enough(mode, settings, self.attempt(mode, at, settings, not at.good))
        if found.outcome != OK or poor(found):
            ridge = shear_of(target, mode)
            if ridge is not None:
                at = whitening_of(target, mode, ridge)
                run, found = self._enough(mode, settings, self.attempt(mode, at, settings, not at.good))
        # Shorter steps help the cheap force too where the posterior has edges; only then is the force itself doubted.
        others = [(True, share) for share in STEPS]
        for exact, shorter in others[1:] if run.exact else [(False, 0.5), *others]:
            if not poor(found):
                break
            again = self.attempt(mode, run.at, settings, exact, shorter)
            run, found = self._enough(mode, settings, again)
        return found

    def attempt(
        self,
        mode: Mode,
        at: Whitening,
        settings: Settings,
        exact: bool = False,
        shorter: float = 1.0,
    ) -> Run:
        """Return as many draws as are asked for; shorter: share of the usual step."""
        target = mode.likelihood.target
        starts, heights, begun = seeded_starts(target, mode, at, settings.chains, settings)
        space = Whitened.of(mode, at, exact)
        warmup = settings.warmup_of(mode)
        count = warmup + settings.draws
        step, given = shorter * STEP, dict[int, Whitened]()
        chains = [
            Chain(space, step, rng)
            if target.deviation is None
            else MixtureChain(mode, space, given, step, rng)
            for rng in (np.random.default_rng([settings.seed, i]) for i in range(settings.chains))
        ]
        left = [
            chain.sampled(u, float(height), count)
            for chain, u, height in zip(chains, starts, heights, strict=True)
        ]
        return Run(at, exact, warmup, begun, chains, tuple(map(np.stack, zip(*left, strict=True))))

    def _enough(self, mode: Mode, settings: Settings, run: Run) -> tuple[Run, Posterior]:
        """Return the run with draws added while they are too few and might suffice, and its posterior."""
        found, count = run.posterior(mode), run.left[0].shape[1]
        most = LONGEST * settings.draws if settings.grows else settings.draws
        while found.outcome != OK and not poor(found) and run.draws < most:
            run = run.longer(count)
            found = run.posterior(mode)
        return run, found


PLUGIN = Nuts()
