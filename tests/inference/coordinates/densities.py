"""Closed-form densities that replace the posterior of a record."""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np

from bayesdamp.types import OK, Evidence


def agrees(evidence: Evidence, area: float, most: float) -> bool:
    """Return whether an evidence is trusted, its stated error is below `most`, and the closed form is within four of
    them (a false alarm in 16,000)."""
    within = abs(evidence.log_evidence - area) < 4 * evidence.stderr
    return bool(evidence.outcome == OK and evidence.stderr < most and within)


def near(curvature: Callable, reflected: np.ndarray) -> Any:
    """Return a likelihood with this value, gradient and information."""
    target = SimpleNamespace(reflected=reflected)
    return SimpleNamespace(curvature=curvature, gradient=lambda z: curvature(z)[:2], target=target)


def posterior_of(
    names: tuple[str, ...], reflected: np.ndarray, at: np.ndarray, height: Callable, curvature: Callable
) -> tuple[Any, Any]:
    """Return a target with this density, and its mode at scores `at`."""
    law = SimpleNamespace(parameters=names)
    target = SimpleNamespace(names=names, noise="gaussian", reflected=reflected, oscillator=law)
    information = curvature(at)[2]
    factor = np.linalg.cholesky(np.linalg.inv(information))
    sds = np.sqrt(np.diag(factor @ factor.T))
    return target, SimpleNamespace(
        z=at, information=information, factor=factor, sd=lambda: sds, linear=None,
        likelihood=SimpleNamespace(folded=height), near=near(curvature, reflected),
    )  # fmt: skip
