"""What is stored of one candidate on one record."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from bayesdamp.store.contents.content import Content
from bayesdamp.types import AddedForm, Forecast, PartialFit, Seed

NAN = float("nan")


@dataclass(frozen=True)
class Climb:
    """A search for the mode: the seed it started from and those that would have started there too, log posterior at
    both ends, likelihoods, log volume at the end; distance: of the start from the mode, in sds; mode: number of the
    maximum it ended in, 0 for the highest, None for none."""

    seed: Seed
    same: tuple[Seed, ...]
    start: float
    end: float
    evaluations: int
    volume: float
    converged: bool
    distance: float = NAN
    mode: int | None = None


@dataclass(frozen=True)
class RefusedSeed:
    """A seed without values to start from, and what its method said."""

    seed: Seed
    outcome: str


@dataclass(frozen=True)
class Maximum:
    """A maximum of the posterior: its height (nats), its share of the posterior, its parameters."""

    log_posterior: float
    share: float
    values: Mapping[str, float]


@dataclass(frozen=True)
class ModeContent(Content):
    """A posterior mode (`mode/NAME/REPEAT/CANDIDATE`).

    values, sd: of the inferred parameters; known: the others; priors in words. climbs, modes: what searches came to;
    touching_zero: coefficients within a standard deviation of zero. stored: an `inference.fit.mode.StoredMode`, as
    `bayesdamp.serial` splits it; its arrays are `stored/...`.
    refused: what had no values to start from; and what was checked of the fit, as
    `inference.checks.checks.Fit` explains it.
    """

    values: Mapping[str, float] = field(default_factory=dict)
    sd: Mapping[str, float] = field(default_factory=dict)
    known: Mapping[str, float] = field(default_factory=dict)
    priors: Mapping[str, str] = field(default_factory=dict)
    log_posterior: float = NAN
    error_budget: Mapping[str, float] = field(default_factory=dict)
    climbs: tuple[Climb, ...] = ()
    modes: tuple[Maximum, ...] = ()
    touching_zero: tuple[str, ...] = ()
    refused: tuple[RefusedSeed, ...] = ()
    windows: tuple[PartialFit, ...] = ()
    rms: float = NAN
    share: float = NAN
    residual_autocorrelation: float = NAN
    predictive_p: float = NAN
    line_p: float = NAN
    form_p: float = NAN
    kurtosis: float = NAN
    tails_p: float = NAN
    window_spread: float = NAN
    window_p: float = NAN
    forecast: Forecast | None = None
    rivals: tuple[AddedForm, ...] = ()
    verdict: str = ""
    stored: Mapping[str, Any] = field(default_factory=dict)
