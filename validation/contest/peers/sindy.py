"""Estimate the damping by PySINDy with its defaults, on a library of spring and damping terms.

The method is thresholded least squares with the threshold 0.1 in SI units. The states are the displacement, and the
velocity by PySINDy's smoothed differences. The damping terms with a positive coefficient are the damping that this
peer names; the method sets small coefficients to zero.
"""

from __future__ import annotations

import numpy as np

from bayesdamp.types import Refusal
from validation.contest.peers.shared import about_rest, even, segments, spectral_peak
from validation.scoring import Reply
from validation.truth.drawing import loss_rate
from validation.truth.oscillator import TERMS

LEAST = 15
"""Least number of samples in a piece between gaps that is used; the smoothing filter of PySINDy needs eleven."""


def answer(t: np.ndarray, y: np.ndarray, amplitudes: tuple[float, ...]) -> Reply:
    """Fit the equation of motion; return its damping ratios at the amplitudes (rad), and its damping terms.

    Raises Refusal if the fitted equation has no spring or no damping.
    """
    import pysindy as ps

    grid, values = even(t, y)
    rest = values[0] - about_rest(grid, values, spectral_peak(grid, values))[0]
    states, times = [], []
    for time, piece in segments(t, y - rest):
        if time.size >= LEAST:
            velocity = ps.SmoothedFiniteDifference()(piece, time)  # pyright: ignore[reportArgumentType]
            states.append(np.column_stack([piece, velocity]))
            times.append(time)
    if not states:
        raise Refusal(f"no piece of the record between gaps has {LEAST} samples")
    library = ps.CustomLibrary(
        [lambda x, v: x, lambda x, v: v, lambda x, v: np.sign(v), lambda x, v: v * np.abs(v)],
        [lambda x, v: "x", lambda x, v: "v", lambda x, v: "sign v", lambda x, v: "v|v|"],
        interaction_only=True,
    )
    model = ps.SINDy(feature_library=library, differentiation_method=ps.SmoothedFiniteDifference())
    model.fit(states, t=times)
    stiffness, *losses = -np.asarray(model.coefficients())[1]
    if stiffness <= 0:
        raise Refusal("the fitted stiffness is not positive")
    terms = dict(zip(TERMS, (0.5 * losses[0], losses[1], losses[2]), strict=True))
    frequency = float(np.sqrt(stiffness))
    ratios = [float(sum(c * loss_rate(term, a, frequency) for term, c in terms.items())) for a in amplitudes]
    if min(ratios) <= 0:
        raise Refusal("the fitted damping ratio is not positive at every amplitude")
    return Reply(ratios, named="+".join(name for name in TERMS if terms[name] > 0), decided=True)
