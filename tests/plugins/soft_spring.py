"""A user's restoring law: a spring that becomes softer as it is stretched."""

import math

import numpy as np

from bayesdamp.physics.restoring import LinearForm, RestoringLaw


class SoftSpring(RestoringLaw):
    """F = k tanh(θ − θ_e)."""

    name = "soft_spring"
    parameters = ("stiffness", "rest_angle")
    translates = True

    @staticmethod
    def kernel(x, p):
        return p[0] * math.tanh(x - p[1])

    def start(self, frequency, rest, known):
        return {"stiffness": frequency**2, "rest_angle": rest, **known}

    def linear_form(self, theta, known):
        rest = known.get("rest_angle", 0.0)
        column = np.tanh(theta - rest)
        if "stiffness" in known:
            return LinearForm(np.zeros((theta.size, 0)), known["stiffness"] * column, lambda c: {})
        return LinearForm(column[:, None], np.zeros_like(theta), lambda c: {"stiffness": float(c[0])})


PLUGINS = [SoftSpring()]
