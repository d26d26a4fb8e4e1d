"""Damping that grows with the square of the displacement, (θ − θ_e)² θ̇ (van der Pol's sign turned)."""

from bayesdamp.physics.forms._form import Form


class Displacement(Form):
    """F = c (θ − θ_e)² θ̇, c in 1/s: a cycle takes π c ω A⁴/4, as much as θ̇³ does."""

    name = "displacement"
    parameter = "c_xxv"
    words = "one that grows with the square of the displacement"
    further = ("rest",)

    @staticmethod
    def kernel(x: float, v: float, epsilon: float, rest: float = 0.0) -> float:
        return (x - rest) * (x - rest) * v

    def ratio_per_unit(self, amplitude: float, frequency: float) -> float:
        return amplitude**2 / (8.0 * frequency)


PLUGIN = Displacement()
