"""The Koopman method: eigenvalues of the generator, also of a record whose parts have different sampling intervals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.estimators.truths import damped_cosine, initial


@pytest.mark.parametrize("every", [1, 3])
def test_the_generator_has_the_eigenvalues_of_the_oscillator(every: int):
    """−ζ ± i√(k − ζ²) of a linear oscillator with k = 25 and ζ = 0.08. Control: those of another damping.

    With `every` = 3 the record has a gap, after which only every third sample remains.
    """
    signal, problem = damped_cosine()
    used = (signal.t < 4.0) | ((signal.t > 5.5) & (np.arange(signal.t.size) % every == 0)) | (every == 1)
    details = initial("koopman", replace(signal, t=signal.t[used], y=signal.y[used]), problem).details
    values = np.array(details["generator_eigenvalues_re"]) + 1j * np.array(
        details["generator_eigenvalues_im"]
    )
    assert np.min(np.abs(values - (-0.08 + 1j * np.sqrt(25.0 - 0.08**2)))) < 0.02
    assert np.min(np.abs(values - (-0.3 + 5.0j))) > 0.1
