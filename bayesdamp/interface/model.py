"""A model of one decay: damping, restoring law, noise, and what is known or believed of their parameters."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bayesdamp import types
from bayesdamp.calls import told
from bayesdamp.interface.fitting.specification import Specification

if TYPE_CHECKING:
    from bayesdamp.interface.density import Density


class Model(Specification):
    """What is asked of a record.

    damping: a sum of damping terms, such as "viscous+coulomb". restoring: the restoring law. noise: a noise model's
    name, several of which one is chosen for the record by evidence, or "auto": all there are. priors: by damping term
    or parameter name; what has none has the default. known: parameter name to its value, which is then not inferred
    (damping coefficients always are); friction's epsilon may stand there for a model without friction, which leaves it
    out. deviation: "none", laws hold exactly; "law" or "auto", they may hold
    approximately, with deviations that are inferred; the size of the noise is then known or read from what
    neither parameters nor deviations take. sensor: then, its relative linearity, below which no damping ratio is known.
    amplitude, frequency: the reference that default priors scale with, unit of the
    displacement and rad/s; by default the system's where it is known, else the record's, to two digits.
    Raises InputError, one line with the nearest valid name, where it makes no sense.

    >>> import bayesdamp as bd
    >>> model = bd.Model("viscous+coulomb", restoring="pendulum", priors={"viscous": bd.HalfNormal(0.1)})
    >>> model.name, model.terms
    ('viscous+coulomb@pendulum', ('viscous', 'coulomb'))
    """

    if not TYPE_CHECKING:
        __init__ = told(Specification.__init__, "Model")

    def bind(self, signal: types.Signal, *, seed: int = 0) -> Density:
        """The posterior density on a record, as plain functions of the parameters in natural units.

        The model is fitted first: where it fits best is where the solver's steps are set. Where laws may hold
        approximately, deviations are integrated out. Raises Refusal with a sentence where that cannot be done on this
        record.
        """
        from bayesdamp.interface.density import Density
        from bayesdamp.interface.fitting.case import Case
        from bayesdamp.interface.fitting.search import checked, deviating, searched

        own = checked(signal, self)
        case = Case.with_noise(own, self)
        if self.approximate:
            mode = deviating(case, self).mode
            return Density.at(own, self, mode.likelihood.target, mode)
        target, mode, _ = searched(case, self, None, seed)
        return Density.at(own, self, target, mode)
