"""The damping term of the how-to page is complete, and its damping ratio is that of its force."""

import pytest

from bayesdamp.physics.damping import DampingTerm
from tests.studies import plugin_source


def test_the_ratio_of_the_term_is_that_of_its_force() -> None:
    names: dict[str, object] = {}
    exec(plugin_source("cubic_drag"), names)
    term = names["PLUGIN"]
    assert isinstance(term, DampingTerm)
    assert term.kernel(0.1, 2.0, 0.01) == 8.0
    by_quadrature = DampingTerm.ratio_per_unit(term, 0.3, 4.5)
    assert term.ratio_per_unit(0.3, 4.5) == pytest.approx(by_quadrature, rel=1e-6)
