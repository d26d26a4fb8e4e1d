"""Numbers and names as the report writes them."""

from __future__ import annotations

import math

import pytest

from bayesdamp import formatting as fmt
from bayesdamp.report import words


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (0.129243, 0.000512, "0.12924 ± 0.00051"),
        (0.1349, 0.0998, "0.13 ± 0.10"),
        (491.234, 0.41, "491.23 ± 0.41"),
        (-243.1, 12.0, "−243 ± 12"),
        (0.0, 0.003, "0.0000 ± 0.0030"),
        (3e-9, 0.12, "0.00 ± 0.12"),
        (2.1e-7, 3e-9, "(2.100 ± 0.030) × 10⁻⁷"),
        (4.2e8, 1.5e6, "(4.200 ± 0.015) × 10⁸"),
        (0.05, math.nan, "0.05000"),
        (0.05, 0.0, "0.05000"),
        (math.nan, 0.1, "–"),
    ],
)
def test_a_value_has_the_digits_of_its_error(value, error, text):
    assert fmt.with_error(value, error) == text


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (12.3456, "12.35"),
        (9.9996, "10.00"),
        (1e-7, "1.000 × 10⁻⁷"),
        (-math.inf, "−∞"),
        (None, "–"),
        (0.0, "0"),
    ],
)
def test_a_number_has_four_digits(value, text):
    assert fmt.number(value) == text


def test_probabilities_are_never_rounded_to_certainty():
    assert fmt.probability(1.0) == "> 0.999"
    assert fmt.probability(0.0) == "< 0.001"
    assert fmt.probability(0.9994) == "0.999"
    assert fmt.probability(math.nan) == "–"


def test_intervals_have_the_digits_of_their_width():
    assert fmt.interval(0.128204, 0.130211) == "[0.12820, 0.13021]"
    assert fmt.interval(-243.3, -200.1) == "[−243, −200]"
    assert fmt.interval(math.nan, 1.0) == "–"


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.0, "0 ms"), (3.04, "3.0 s"), (59.9, "60 s"), (125, "2 min 05 s"), (7265, "2 h 01 min")],
)
def test_durations(seconds, text):
    assert fmt.duration(seconds) == text


def test_names_and_units():
    assert words.model("viscous+coulomb") == "viscous + Coulomb"
    assert words.model("my_term") == "my term"
    assert words.axis("zeta", "1/s") == r"$\zeta$ / (1/s)"
    assert words.axis("theta0", "rad") == r"$\theta_0$ / rad"
    assert fmt.fixed(-0.0004, 2) == "0.00"
    assert fmt.nats(-801.34, 0.008) == "−801.34 ± 0.01"
    assert fmt.nats(-801.34, 0.004) == "−801.34 ± < 0.01"
    assert fmt.nats(-5210.4) == "−5210"
