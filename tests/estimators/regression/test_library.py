"""Predictions of sparse models against an independent solver."""

from __future__ import annotations

import numpy as np
import pytest

from bayesdamp.estimators.regression.library import (
    RecordToPredict,
    candidates,
    predict,
    residual_squares,
)
from bayesdamp.estimators.shared import checked_features
from tests.estimators.truths import pendulum

TRUTH = {"zeta": 0.04, "mu_c": 0.05}


def known(theta):
    return 20.0 * theta - np.cos(theta)


@pytest.fixture(scope="module")
def record():
    (angle, problem), (velocity, _), (acceleration, _) = (
        pendulum(TRUTH, samples=1500, quantity=q) for q in ("angle", "velocity", "acceleration")
    )
    library = candidates(problem, checked_features(angle), "rad")
    period = 2 * np.pi / np.sqrt(20.0)
    curves = angle.y, velocity.y, acceleration.y
    return [
        RecordToPredict(angle.t, y, i, angle.y, velocity.y, known, period) for i, y in enumerate(curves)
    ], library


def model(library, zeta=0.04, mu_c=0.05):
    return np.array([{"viscous": zeta, "coulomb": mu_c}.get(one.damping, 0.0) for one in library])


def test_a_model_predicts_its_own_record(record):
    records, library = record
    x = np.stack([model(library), model(library, zeta=0.05)])
    for one in records:
        curves = predict(one, library, x, np.tile([0.3, 0.0], (2, 1)))
        size = np.abs(one.y).max()
        assert np.abs(curves[:, 0] - one.y).max() < 1e-3 * size
        # Negative control: another coefficient does not.
        assert np.abs(curves[:, 1] - one.y).max() > 1e-2 * size


def test_an_error_of_the_regression_is_not_one_of_the_model(record):
    (angle, *_), library = record
    unit = np.array([0.5 * abs(c) if c else 1.0 for c in model(library)])
    right, near, wrong = residual_squares(
        angle, library, np.stack([model(library), model(library, 0.042, 0.048), model(library, 0.09, 0.0)]),
        unit, 0.0,
    ) / angle.t.size  # fmt: skip
    assert near < (1e-4 * 0.3) ** 2
    assert right < (1e-4 * 0.3) ** 2
    assert wrong > (3e-3 * 0.3) ** 2
