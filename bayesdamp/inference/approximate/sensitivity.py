"""What the evidence of a law that holds approximately depends on: the widths of the damping coefficients' priors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bayesdamp.inference.approximate.evidence import by_importance
from bayesdamp.inference.approximate.law import Approximate
from bayesdamp.inference.deviation.single import under
from bayesdamp.inference.evidence.widths import Widths, against_width
from bayesdamp.priors import Prior
from bayesdamp.types import Evidence

Array = NDArray[np.float64]


def over_widths(law: Approximate, y: Array, log_weights: Array, seed: int) -> Widths:
    """Evidence under narrower and wider priors of the damping coefficients; y, log_weights: as `by_importance` leaves
    them."""

    def anew(priors: Mapping[str, Prior], seed: int) -> Evidence:
        one = under(law.single, priors)
        return by_importance(replace(law, single=one), "", "", seed)

    priors = {n: law.single.found.priors[n] for n in law.names}
    coefficients = [n for n in law.oscillator.coefficients if n in priors]
    return against_width(priors, coefficients, y, log_weights, anew, seed)
