"""Estimate damping with a physics-informed neural network.

The method is that of section 3.5, equations 17 to 19, of the paper that `bayesdamp.estimators` cites.

The motion θ(t) is a network. Its inputs are time, and the sines and cosines of the phase of the recorded oscillation
and of multiples of this phase. Angles are in units of the amplitude A, and the residual of the equation of motion in
units of Aω², with the angular frequency ω. Damping coefficients are trained along with the weights. Time derivatives
follow from the chain rule, derivatives by the unknowns from automatic differentiation; the loss, a sum of squares, is
lowered by Levenberg–Marquardt steps.
"""

from typing import Literal

import numpy as np
from pydantic import Field

from bayesdamp.estimators.shared import Estimator, Options, checked_features, optional_package
from bayesdamp.types import Estimate, Problem, Signal


class PinnOptions(Options):
    """Options of the physics-informed network.

    start: first damping coefficients: those with an equivalent damping ratio of 0.05 for each term ("uninformed"), or
    those from the energy that the record loses ("direct"). width: number of units in each of the two hidden layers.
    harmonics: number of harmonics of the record's frequency among the inputs, the fundamental included. collocation:
    number of instants at which the equation of motion is evaluated. physics_weight, start_weight: λ1 and λ2 of equation
    (17) of the paper that `bayesdamp.estimators` cites: the weights of the squared misfits of the equation of motion
    and of a known start, relative to the record. rounds: largest number of training steps.
    """

    start: Literal["uninformed", "direct"] = "uninformed"
    width: int = Field(default=14, ge=4, le=64)
    harmonics: int = Field(default=3, ge=1, le=10)
    collocation: int = Field(default=500, ge=50, le=5000)
    physics_weight: float = Field(default=10.0, gt=0.0)
    start_weight: float = Field(default=10.0, ge=0.0)
    rounds: int = Field(default=300, ge=1, le=5000)


class Pinn(Estimator[PinnOptions]):
    """Train damping coefficients and unknown restoring parameters together with a network for the motion.

    A negative coefficient is not set to 0.
    """

    by_position = "the damping in its loss is a function of the velocity alone"
    options = PinnOptions

    def initial(
        self, signal: Signal, problem: Problem, options: PinnOptions, rng: np.random.Generator
    ) -> Estimate:
        """Return the coefficients with which a network for the motion fits record and equation of motion best.

        The unknown restoring parameters and an unknown start are those of the same network. There are no standard
        errors. The outcome is a sentence if the training did not converge. Raises Refusal if PyTorch is not installed,
        if `checked_features` or `motion` refuses the record, or if the loss is not finite.
        """
        optional_package("torch")
        from bayesdamp.estimators.networks import collocation

        return collocation.estimate(signal, problem, checked_features(signal), rng, options)


PLUGIN = Pinn()
