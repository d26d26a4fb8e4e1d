"""Trajectories and their tangents as compiled machine code: what the quick answer is made of."""

from bayesdamp.physics.kernel.build import Kernel, kernel_of
from bayesdamp.physics.kernel.solve import Motion, Solver

__all__ = ["Kernel", "Motion", "Solver", "kernel_of"]
