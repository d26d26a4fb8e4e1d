"""What is fixed of a motion while its parameters vary: where it is solved, and where the samples lie in that."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np

from bayesdamp.machine.programs import Program
from bayesdamp.numerics.lazily import jax
from bayesdamp.physics.oscillator import Oscillator, Parameters
from bayesdamp.physics.solver.tangents import with_slopes

if TYPE_CHECKING:
    from jax import Array

QUANTITIES = ("angle", "velocity", "acceleration")


class Plan(ABC):
    """Made at reference parameters, and a tree of arrays: `record` is a pure function of plan and parameters."""

    together: ClassVar[int | None] = None
    """Motions that a batch should hold at most; None for any number."""

    @property
    def whole(self) -> Self:
        """The plan of all samples, of which this one's are the `kept`: parts share its programs."""
        return self

    @property
    def kept(self) -> slice:
        """Which samples of the whole plan are in it: all."""
        return slice(None)

    @abstractmethod
    def record(self, osc: Oscillator, p: Parameters) -> Array:
        """The planned quantity at the samples, shape (n,), in rad, rad/s or rad/s²; jit, vmap and forward tangents
        work on it. Not finite where the trajectory escapes."""

    @abstractmethod
    def of(self, samples: slice) -> Plan:
        """Of some of its samples; the motion starts where it did."""

    @abstractmethod
    def finer(self, osc: Oscillator, p: Parameters, parts: int, times: np.ndarray, quantity: str) -> Plan:
        """A much finer one of the same samples, s, (n,). parts: into how many a step is divided, where there are
        steps."""

    def corrected(self, osc: Oscillator, finer: Plan, p: Parameters) -> Plan:
        """Set right at `p`: there its trajectory is that of the finer plan.

        Near there the error is a share of the distance to that trajectory, however many samples ask for how
        little: the steps need not be shorter for a longer record. Not every plan can be.
        """
        del osc, finer, p
        return self

    def at_samples(self, osc: Oscillator, p: Parameters) -> np.ndarray:
        """`record` in numbers."""
        return np.asarray(compiled_record(osc)(self.whole, _values(osc, p)))[self.kept]

    def many_at_samples(self, osc: Oscillator, values: Mapping[str, np.ndarray]) -> np.ndarray:
        """`at_samples` at many sets of parameters: values by name, each (m,); shape (m, n)."""
        sets = (dict(zip(values, one)) for one in zip(*values.values(), strict=True))
        return np.stack([self.at_samples(osc, one) for one in sets])

    def record_and_slopes(self, osc: Oscillator, names: Sequence[str], p: Parameters) -> tuple[Array, Array]:
        """`record`, and its derivatives by the parameters of these names, (k, n), compiled."""
        found, slopes = _record_and_slopes(osc, tuple(names))(self.whole, {n: p[n] for n in osc.inputs})
        return found[self.kept], slopes[:, self.kept]


def _values(osc: Oscillator, p: Parameters) -> dict[str, Any]:
    return {name: np.asarray(p[name], float) for name in osc.inputs}


@lru_cache(maxsize=128)
def compiled_record(osc: Oscillator) -> Program:
    """`Plan.record` of one oscillator, compiled once per shape of plan: (plan, parameters) -> samples."""

    def record(plan: Plan, p: Parameters) -> Array:
        return plan.record(osc, p)

    return Program(record, "record", osc)


@lru_cache(maxsize=64)
def _record_and_slopes(osc: Oscillator, names: tuple[str, ...]) -> Program:
    def both(plan: Plan, p: Parameters) -> tuple[Array, Array]:
        return with_slopes(lambda q: plan.record(osc, q), names, p)

    return Program(both, "record_and_slopes", osc, names)


@lru_cache(maxsize=64)
def compiled_records(osc: Oscillator) -> Program:
    """The same at many sets of parameters."""

    def records(plan: Plan, many: Parameters) -> Array:
        return jax.vmap(lambda p: plan.record(osc, p))(many)

    return Program(records, "records", osc)
