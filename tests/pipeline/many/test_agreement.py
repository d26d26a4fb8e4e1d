"""Whether records are said to agree with one damping: normal likelihoods, by hand."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bayesdamp.pipeline.many.agreement import chance_of, disagrees, verdict
from bayesdamp.store.contents.many import BayesFactor


def mode(places: list[float], common: float | None = None) -> Any:
    """Records whose damping is measured at these places with an sd of 1, at their own or at a common value."""

    def local(place: float) -> SimpleNamespace:
        return SimpleNamespace(log_likelihood=lambda z: -0.5 * (z[:, 0] - place) ** 2)

    at = places if common is None else [common] * len(places)
    joint = SimpleNamespace(split=lambda x: [np.array([one]) for one in x], records=places)
    return SimpleNamespace(local=[local(p) for p in places], joint=joint, x=np.array(at))


def chance(*places: float) -> float:
    alone = [mode([p]) for p in places]
    return chance_of(mode(list(places), float(np.mean(places))), alone, 1)


def test_two_records_five_sds_apart() -> None:
    """(a − b)² / 2 has χ² of one degree: its tail is that of a normal."""
    assert chance(0.0, 5.0) == pytest.approx(math.erfc(5 / 2))
    assert chance(0.0, 1.0) == pytest.approx(math.erfc(1 / 2))


def test_three_records_have_two_degrees() -> None:
    assert chance(-2.0, 0.0, 2.0) == pytest.approx(math.exp(-4))


def test_evidence_from_a_wide_prior_does_not_make_records_agree() -> None:
    """Under a prior of 100,000 sds one damping is ahead of two by ln(1e5 / √2) − d² / 4 nats where they are d sds
    apart: what the prior of a second damping costs. At 5 sds that is 5 nats for one. Control: near each other."""
    far, near = (
        BayesFactor(math.log(1e5 / math.sqrt(2)) - b**2 / 4, chance=chance(0.0, b)) for b in (5.0, 1.0)
    )
    assert far.log_bayes_factor > 4
    assert disagrees(far)
    assert not far.clear
    assert verdict("damping", far).startswith("the records differ in their damping")
    assert not disagrees(near)
    assert near.clear
    assert verdict("damping", near).startswith("the records agree with one damping")


def test_what_was_not_found_says_nothing() -> None:
    assert math.isnan(chance_of(mode([0.0, 1.0], 0.5), (), 1))
    assert BayesFactor(4.0).clear
