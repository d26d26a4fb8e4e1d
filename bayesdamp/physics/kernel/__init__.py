"""Integrate trajectories and their derivatives by the parameters (tangents), with compiled machine code."""

from bayesdamp.physics.kernel.build import Kernel, kernel_of
from bayesdamp.physics.kernel.solve import Motion, Solver

__all__ = ["Kernel", "Motion", "Solver", "kernel_of"]
