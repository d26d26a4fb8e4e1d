"""What a joint fit takes of one of its records: prior and likelihood in scores, under laws that hold exactly."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from bayesdamp.inference.fit.mode import NEAR, Mode, restore_mode
from bayesdamp.inference.model import batches
from bayesdamp.inference.model.compiled import compiled
from bayesdamp.inference.model.density import LOG_2PI
from bayesdamp.inference.model.target import Target
from bayesdamp.physics.oscillator import Oscillator
from bayesdamp.priors import Prior
from bayesdamp.types import Refusal


class Local(Protocol):
    """A record's likelihood about some scores."""

    @property
    def z(self) -> np.ndarray:
        """The scores, (d,)."""
        ...

    @property
    def information(self) -> np.ndarray:
        """Of the record's own log posterior there, (d, d)."""
        ...

    def curvature(self, z: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        """Log likelihood at scores z, (d,), its gradient (d,) and information (d, d)."""
        ...

    def log_likelihood(self, z: np.ndarray) -> np.ndarray:
        """Log likelihood at scores z, (n, d): (n,), −∞ where a motion escapes."""
        ...

    def cost(self, z: np.ndarray) -> float:
        """Nats by which the log posterior is lower at other scores, (d,); roughly, where they are far."""
        ...

    def holds(self, z: np.ndarray) -> bool:
        """Whether what was prepared about `z` is still right at other scores, (d,)."""
        ...


class Record(Protocol):
    """A record under one candidate."""

    @property
    def oscillator(self) -> Oscillator:
        """The candidate's laws."""
        ...

    @property
    def priors(self) -> Mapping[str, Prior]:
        """Of what is inferred, in the order of the scores."""
        ...

    @property
    def live(self) -> tuple[str, ...]:
        """Names of what is inferred and what something depends on."""
        ...

    def scores(self, values: Mapping[str, float]) -> np.ndarray:
        """Scores of values by name, (d,)."""
        ...

    def about(self, z: np.ndarray) -> Local:
        """The likelihood about scores z, (d,). Raises Refusal where there is none."""
        ...


@dataclass(frozen=True)
class Exact:
    """A record under laws that hold exactly. tolerance: of the solver's plans, in the unit of the record."""

    target: Target
    tolerance: float

    @property
    def oscillator(self) -> Oscillator:
        """Its laws."""
        return self.target.oscillator

    @property
    def priors(self) -> Mapping[str, Prior]:
        """Of what is inferred."""
        return self.target.priors

    @property
    def live(self) -> tuple[str, ...]:
        """Without the coefficients that are 0 at every score."""
        return self.target.live

    def scores(self, values: Mapping[str, float]) -> np.ndarray:
        """Scores of values by name, (d,)."""
        return self.target.scores(values)

    def about(self, z: np.ndarray) -> Planned:
        """With a plan of the solver that is right at scores z, (d,). Raises Refusal."""
        target = self.target
        at = restore_mode(target, z, np.nan, np.eye(z.size), self.tolerance)
        value, _, information = compiled(target.layout).curvature(at.context.held(1.0), z)
        if not np.isfinite(value):
            raise Refusal("a record has no finite likelihood where the joint mode is looked for")
        return Planned(target, at, np.asarray(information))


@dataclass(frozen=True)
class Planned:
    """The likelihood on the plan of a mode."""

    target: Target
    mode: Mode
    information: np.ndarray

    @property
    def z(self) -> np.ndarray:
        """Scores at which the plan was made, (d,)."""
        return self.mode.z

    def curvature(self, z: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        """Log likelihood at scores z, (d,), its gradient (d,) and information (d, d)."""
        found = compiled(self.target.layout).curvature(self.mode.context.held(1.0), z)
        value, slope, information = map(np.asarray, found)
        prior = -0.5 * float(z @ z) - 0.5 * z.size * LOG_2PI
        return float(value) - prior, slope + z, information - np.eye(z.size)

    def log_likelihood(self, z: np.ndarray) -> np.ndarray:
        """Log likelihood at scores z, (n, d): (n,), −∞ where a motion escapes."""
        return batches.log_likelihood(self.target, self.mode.context, z)

    def cost(self, z: np.ndarray) -> float:
        """Of the parabola at the mode: the plan is of no use far from it."""
        away = z - self.z
        return 0.5 * float(away @ self.information @ away)

    def holds(self, z: np.ndarray) -> bool:
        """Whether the plan is still right at the scores z."""
        return self.cost(z) < 0.5 * NEAR**2
