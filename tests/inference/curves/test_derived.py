"""Derived quantities against closed forms of the linear law."""

import math

import numpy as np

from bayesdamp.inference.derived import Motions, derive_quantities
from bayesdamp.physics.oscillator import Oscillator

K, A, INERTIA = 20.0, 0.3, 0.7
W = math.sqrt(K)
SIZES = np.array([[0.01, 0.05], [0.1, 0.2]])
LINEAR = {"stiffness": K, "rest_angle": 0.1}


def motions(damping: tuple[str, ...], inertia: float | None = INERTIA, **p: object) -> Motions:
    return Motions(Oscillator(damping, "linear"), {**LINEAR, **p}, 0.0, A, inertia)


EXPECTED = {
    "viscous": {
        "damping_ratio": SIZES / W,
        "quality_factor": W / (2 * SIZES),
        "equivalent_ratio": SIZES / W,
        "log_decrement": 2 * math.pi * SIZES / W,
        "half_life": math.log(2) / SIZES,
        "energy_fraction": 4 * math.pi * SIZES / W,
        "energy_lost": INERTIA * 2 * math.pi * SIZES * W * A**2,
        "viscous_coefficient": 2 * INERTIA * SIZES,
    },
    "coulomb": {
        "equivalent_ratio": 2 * SIZES / (math.pi * K * A),
        "log_decrement": 4 * SIZES / (K * A),
        "half_life": math.pi * W * A / (4 * SIZES),
        "energy_fraction": 4 * SIZES * A / (K * A**2 / 2),
        "energy_lost": INERTIA * 4 * SIZES * A,
        "coulomb_torque": INERTIA * SIZES,
    },
    "quadratic": {
        "equivalent_ratio": 4 * SIZES * A / (3 * math.pi),
        "log_decrement": 8 / 3 * SIZES * A,
        "half_life": 3 * math.pi / (4 * SIZES * W * A),
        "energy_fraction": 16 / 3 * SIZES * A,
        "energy_lost": INERTIA * 8 / 3 * SIZES * K * A**3,
        "quadratic_coefficient": INERTIA * SIZES,
    },
}


def test_quantities_have_the_closed_forms_of_the_linear_law():
    for term, name in {"viscous": "zeta", "coulomb": "mu_c", "quadratic": "mu_q"}.items():
        result = derive_quantities(motions((term,), **{name: SIZES}, epsilon=1e-5 * A * W))
        assert set(result) == set(EXPECTED[term])
        for quantity, expected in EXPECTED[term].items():
            np.testing.assert_allclose(result[quantity], expected, rtol=1e-6, err_msg=quantity)
    assert "energy_lost" not in derive_quantities(motions(("viscous",), None, zeta=np.array([0.0, 0.1])))


def test_losses_of_two_terms_add():
    """Energies, ratios and decrements. Control: half-lives do not add."""
    viscous = derive_quantities(motions(("viscous",), zeta=SIZES))
    quadratic = derive_quantities(motions(("quadratic",), mu_q=SIZES))
    both = derive_quantities(motions(("viscous", "quadratic"), zeta=SIZES, mu_q=SIZES))
    for quantity in ("equivalent_ratio", "log_decrement", "energy_fraction", "energy_lost"):
        np.testing.assert_allclose(both[quantity], viscous[quantity] + quadratic[quantity], rtol=1e-9)
    np.testing.assert_allclose(both["damping_ratio"], viscous["damping_ratio"])
    assert not np.allclose(both["half_life"], viscous["half_life"] + quadratic["half_life"], rtol=0.1)


def test_the_natural_frequency_is_derived_if_the_stiffness_is_inferred():
    assert "natural_frequency" not in derive_quantities(motions(("viscous",), zeta=SIZES))
    result = derive_quantities(motions(("viscous",), zeta=SIZES, stiffness=100 * SIZES))
    np.testing.assert_allclose(result["natural_frequency"], 10 * np.sqrt(SIZES))
    np.testing.assert_allclose(result["damping_ratio"], 0.1 * np.sqrt(SIZES))
