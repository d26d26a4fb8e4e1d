"""A power of the velocity with a free exponent: Coulomb's, viscous and quadratic damping are its 0, 1 and 2."""

from bayesdamp.physics.forms._form import Form


class Power(Form):
    """F = c V |θ̇/V|^p sgn θ̇ with V a reference velocity, c in 1/s; rounded within ε so that it may switch at p = 0."""

    name = "power"
    parameter = "c_power"
    words = "a power of the velocity"
    switches = True
    further = ("exponent", "reference_velocity")

    @staticmethod
    def kernel(x: float, v: float, epsilon: float, p: float = 1.0, scale: float = 1.0) -> float:
        return v * ((v * v + epsilon * epsilon) / (scale * scale)) ** (0.5 * (p - 1.0))

    def ratio_per_unit(self, amplitude: float, frequency: float) -> float:
        return 0.5 / frequency


PLUGIN = Power()
