"""A damping term of one's own, proportional to the cube of the velocity."""

import bayesdamp as bd
from bayesdamp.physics.damping import TERMS


class CubicDrag(bd.DampingTerm):
    name, parameter, unit, words = "cubic_drag", "drag3", "s/rad²", "cubic drag"

    @staticmethod
    def kernel(x: float, v: float, epsilon: float) -> float:
        return v**3


TERMS.add("cubic_drag", CubicDrag())
signal = bd.simulate({"cubic_drag": 0.8}, "linear", stiffness=20.0, duration=6.0, samples=150, noise_sd=0.003)
print(bd.fit(signal, bd.Model("cubic_drag", noise="gaussian")))
