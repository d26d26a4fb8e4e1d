"""A user's damping term: drag that grows with the third power of the velocity."""

from bayesdamp.physics.damping import DampingTerm


class CubicDrag(DampingTerm):
    """F = μ₃ θ̇³."""

    name = "cubic_drag"
    parameter = "drag3"
    unit = "s/rad²"

    @staticmethod
    def kernel(x, velocity, epsilon):
        return 1.0 * velocity**3


PLUGIN = CubicDrag()
