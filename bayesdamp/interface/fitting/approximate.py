"""A model on a record where laws may hold approximately, as Python asks for it and keeps it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from bayesdamp.inference.approximate.law import Approximate
from bayesdamp.inference.deviation.data import prepared
from bayesdamp.inference.deviation.findings import default_amplitudes
from bayesdamp.inference.deviation.numbers.averaging import START, averaging_of
from bayesdamp.inference.deviation.quick import MOST_CYCLES
from bayesdamp.inference.deviation.single import single
from bayesdamp.interface.fitting.case import Case
from bayesdamp.pipeline.answer import in_base
from bayesdamp.units import Unit

if TYPE_CHECKING:
    import pandas as pd

Array = NDArray[np.float64]


def approximate_of(case: Case) -> Approximate:
    """Fit it. Raises Refusal where that cannot be done."""
    model = case.model
    weighed = partial(
        single,
        damping=model.terms,
        restoring=model.restoring,
        known=model.known,
        priors=model.parameter_priors,
        reference=case.reference,
    )
    found = weighed(prepared(case.signal, average=not any(n in model.known for n in START)))
    averaging = averaging_of(found.weighing)
    if averaging is not None and not averaging.close and averaging.cycles <= MOST_CYCLES:
        found = weighed(prepared(case.signal, average=False))
    return Approximate(found, model.sensor)


def ratios_of(
    approximate: Approximate, amplitudes: Sequence[float] | None, u: Array, unit: Unit
) -> pd.DataFrame:
    """A row for each amplitude: amplitude and its unit, value, sd_noise, sd_law, low, high. unit: of the amplitudes,
    asked for and given. Raises InputError for one that the record does not have."""
    import pandas as pd

    weighing = approximate.single.weighing
    wanted = in_base(amplitudes, weighing, unit) or default_amplitudes(weighing)
    own = unit.displacement
    rows = [
        {**asdict(r), "amplitude": r.amplitude * own.scale, "unit": own.name}
        for r in approximate.ratios(wanted, u)
    ]
    columns = ["amplitude", "unit", *(name for name in rows[0] if name not in ("amplitude", "unit"))]
    return pd.DataFrame(rows, columns=columns)
