"""What is stored of a record, and of what was chosen for it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from bayesdamp.store.contents.content import Content
from bayesdamp.types import OK, FeaturesSeen


@dataclass(frozen=True)
class Scales:
    """Reference amplitude (rad or m) and angular frequency (rad/s) that default priors scale with."""

    amplitude: float
    frequency: float


@dataclass(frozen=True)
class RecordContent(Content):
    """A record (`signal/NAME/REPEAT`).

    provenance: what was done to it. step: recording step, 0 where none is seen. bound: the Cramér–Rao bound of a
    simulated one, sd by parameter. Where it shows an oscillation: features; anomalies, in words;
    reference; known: of the system, friction's ε (rad/s) filled in, with a note; noisy: whether there is noise to weigh
    by.
    """

    name: str = ""
    unit: str = "rad"
    quantity: str = "angle"
    step: float = 0.0
    provenance: Mapping[str, Any] = field(default_factory=dict)
    bound: Mapping[str, float] = field(default_factory=dict)
    features: FeaturesSeen | None = None
    anomalies: tuple[str, ...] = ()
    reference: Scales | None = None
    known: Mapping[str, float] = field(default_factory=dict)
    epsilon_note: str = ""
    noisy: bool = False

    @property
    def scales(self) -> Scales:
        """The reference of a record with an oscillation. Raises ValueError where it has none."""
        if self.reference is None:
            raise ValueError(f"{self.name} shows no oscillation")
        return self.reference


@dataclass(frozen=True)
class NoiseTried:
    """One noise model: log evidence by Laplace's approximation (nats) and its parameters; held: judged by the residuals
    of another's fit, being far behind there."""

    noise: str
    log_evidence: float = -np.inf
    values: Mapping[str, float] = field(default_factory=dict)
    held: bool = False
    outcome: str = OK


@dataclass(frozen=True)
class WidthTried:
    """One ε, as a share of the peak velocity and in rad/s: log evidence (nats), each coefficient's value and sd."""

    share: float
    epsilon: float
    log_evidence: float = -np.inf
    coefficients: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    outcome: str = OK


@dataclass(frozen=True)
class NoiseContent(Content):
    """What was chosen for a record (`noise/NAME/REPEAT`), under all damping terms in play.

    chosen: the noise model; weighed: all that were in play. restoring: the law that fits best; fits: parameters under
    each. epsilon: friction's, rad/s, where another than the usual one suits the record; usual_epsilon: that one, None
    where nothing was open; epsilons: all that were tried; friction: coefficients of the terms that switch.
    """

    chosen: str
    damping: tuple[str, ...]
    restoring: str
    fits: Mapping[str, Mapping[str, float]]
    weighed: tuple[NoiseTried, ...]
    epsilon: float | None = None
    usual_epsilon: float | None = None
    epsilon_unit: str = ""
    epsilons: tuple[WidthTried, ...] = ()
    friction: tuple[str, ...] = ()
    epsilon_note: str = ""
