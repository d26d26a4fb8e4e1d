"""Physics-informed neural network (paper, section 3.5, equations 17 to 19).

θ(t) is a network whose inputs are time and the sines and cosines of the record's own phase and its harmonics; angles
are in amplitudes and the residual of the equation of motion in units of Aω². Damping coefficients are trained along
with the weights. Time derivatives are carried through the network by hand, and the loss, a sum of squares, is
lowered by Levenberg–Marquardt steps.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import Field

from bayesdamp.estimators._protocol import Estimator, Options, optional_package
from bayesdamp.estimators.shared import checked_features, free_start
from bayesdamp.types import Estimate, Problem, Refusal, Signal


class PinnOptions(Options):
    """Options of the physics-informed network.

    start: damping at an equivalent ratio of 0.05, whatever the record, or from its loss of energy.
    width: units in each of the two hidden layers. harmonics: of the record's frequency among the inputs.
    collocation: number of instants at which the equation of motion is evaluated.
    physics_weight, start_weight: λ1 and λ2 of equation (17). rounds: largest number of training steps.
    """

    start: Literal["uninformed", "direct"] = "uninformed"
    width: int = Field(default=20, ge=4, le=64)
    harmonics: int = Field(default=3, ge=1, le=10)
    collocation: int = Field(default=500, ge=50, le=5000)
    physics_weight: float = Field(default=10.0, gt=0.0)
    start_weight: float = Field(default=10.0, ge=0.0)
    rounds: int = Field(default=300, ge=1, le=5000)


class Pinn(Estimator[PinnOptions]):
    """Damping coefficients, and free restoring parameters, of a network trained on record and equation of motion.

    A negative coefficient is reported as it is.
    """

    by_position = "the damping in its loss is a function of the velocity alone"
    with_parameters = "its loss has one weight for each term"
    options = PinnOptions

    def initial(
        self, signal: Signal, problem: Problem, options: PinnOptions, rng: np.random.Generator
    ) -> Estimate:
        """Train coefficients together with a network for the motion, by its residual in the equation."""
        optional_package("torch")
        from bayesdamp.estimators.networks.collocation import Collocation
        from bayesdamp.estimators.networks.training import gauss_newton, single_thread

        features = checked_features(signal)
        with single_thread():
            loss = Collocation(signal, problem, features, rng, **options.model_dump(exclude={"rounds"}))
            training = gauss_newton(
                loss.residuals, loss.linearise, loss.start, options.rounds, loss.scaled_damping
            )
        if not np.all(np.isfinite(training.losses)):
            raise Refusal("the network's training came to numbers that are not finite")
        watched = training.watched * loss.units.numpy()[: len(loss.coefficients)]
        names = (*loss.coefficients, *loss.restoring)
        values = dict(zip(names, map(float, loss.physical(training.x))))
        values |= free_start(problem, *loss.start_of(training.x))
        trace = {"loss": training.losses, **dict(zip(loss.coefficients, watched.T))}
        details = {"start": options.start, "started_from": watched[0].tolist(), **loss.misfits(training.x)}
        count, outcome = training.evaluations, training.outcome
        return Estimate(self.name, "initial", values, {}, trace, details, evaluations=count, outcome=outcome)


PLUGIN = Pinn()
