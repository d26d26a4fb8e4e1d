"""Estimate damping with a neural ordinary differential equation.

The method is that of section 3.6, equation 20, of the paper that `bayesdamp.estimators` cites.

The equation is ẏ = (θ̇, −F_rest(θ) − f(θ̇)) for the state y = (θ, θ̇). F_rest is the given restoring law; the damping
force f is a neural network that is an odd function of the velocity. The network is trained through the solver of the
equation by multiple shooting: the record is cut into segments of about half a cycle, which are integrated as one batch,
and the jumps of the motion from one to the next are part of the loss. Automatic differentiation gives the derivatives
of every step of the solver by the weights and by the state before the step, so that each training step is a
Levenberg–Marquardt step.

The coefficients are the projection of the learnt force on the damping law (the sum of the problem's terms): with them
the damping law dissipates, as nearly as possible, the same mean power as the learnt force in each segment.
"""

import numpy as np
from pydantic import Field

from bayesdamp.estimators.shared import Estimator, Options, checked_features, optional_package
from bayesdamp.types import Estimate, Problem, Signal


class NeuralOdeOptions(Options):
    """Options of the neural ODE.

    width: number of units in each of the two hidden layers of the force's network. steps: number of steps of the solver
    in a cycle (at least 8 in a segment). continuity_weight: factor of the jumps of the motion from one segment to the
    next, and of the misfit of a known start, before they are squared and added to the mean square misfit of the record
    (all as fractions of the amplitude). rounds: largest number of training steps.
    """

    width: int = Field(default=8, ge=2, le=64)
    steps: int = Field(default=48, ge=12, le=1000)
    continuity_weight: float = Field(default=1.0, gt=0.0)
    rounds: int = Field(default=150, ge=1, le=5000)


class NeuralOde(Estimator[NeuralOdeOptions]):
    """Learn the damping force as a network, and project it on the damping law (the sum of the problem's terms).

    A negative coefficient is not set to 0. The details of the estimate are three lists: velocities (`velocity`, rad/s),
    and at these the learnt force (`force`, rad/s²) and the force of the damping law with the estimated coefficients
    (`law`, rad/s²).
    """

    by_position = "its network computes the force from the velocity alone"
    options = NeuralOdeOptions

    def initial(
        self, signal: Signal, problem: Problem, options: NeuralOdeOptions, rng: np.random.Generator
    ) -> Estimate:
        """Train a network for the damping force, and return the coefficients of its projection on the damping terms.

        Unknown restoring parameters and an unknown start are trained with it. There are no standard errors. The outcome
        is a sentence if the training did not converge. Raises Refusal if PyTorch or torchdiffeq is not installed, if
        `checked_features` or `motion` refuses the record, or if a trajectory is not finite.
        """
        optional_package("torch")
        optional_package("torchdiffeq")
        from bayesdamp.estimators.networks import shooting

        return shooting.estimate(signal, problem, checked_features(signal), rng, options)


PLUGIN = NeuralOde()
