"""Models: equality, names of parameters, and wrong arguments."""

import dataclasses
from functools import partial

import pytest

import bayesdamp as bd
from tests.interface.problems import not_refused


def test_terms_have_one_order_and_models_are_keys() -> None:
    model, same = (
        bd.Model(damping, "pendulum", priors={"viscous": bd.HalfNormal(0.1)}, known={"stiffness": stiffness})
        for damping, stiffness in (("coulomb+viscous", 20), ("viscous+coulomb", 20.0))
    )
    assert model == same
    assert {model: 1}[same] == 1
    assert model != dataclasses.replace(same, noise="gaussian")
    assert model.name == "viscous+coulomb@pendulum"


def test_a_name_of_both_a_term_and_a_parameter_of_the_law_means_the_law() -> None:
    """Control: under a law without this parameter it means the term."""
    prior = bd.HalfNormal(0.1)
    model = bd.Model("cubic", "duffing", priors={"mu_3": prior}, known={"cubic": 1.0})
    assert model.system.known == {"cubic": 1.0}
    assert model.parameter_priors == {"mu_3": prior}
    both = bd.Model("cubic", "duffing", priors={"mu_3": prior, "cubic": bd.Normal(0.0, 1.0)})
    assert both.system.free["mu_3"] == prior
    assert both.system.free["cubic"] == bd.Normal(0.0, 1.0)
    assert bd.Model("cubic", priors={"cubic": prior}).parameter_priors == {"mu_3": prior}


def test_a_known_width_of_friction_has_no_effect_without_friction() -> None:
    known = {"stiffness": 20.0, "epsilon": 0.05}
    assert bd.Model("coulomb", known=known).known == known
    assert bd.Model("viscous", known=known) == bd.Model("viscous", known={"stiffness": 20.0})
    with pytest.raises(bd.InputError, match="at least 0"):
        bd.Model("viscous", known={"epsilon": -1.0})


REFUSED: list[tuple[dict, str]] = [
    ({"damping": "viscos"}, "did you mean 'viscous'"),
    ({"damping": ""}, "sum of different terms"),
    ({"restoring": "pendulm"}, "^Model: unknown restoring law 'pendulm'; did you mean 'pendulum'"),
    ({"noise": ()}, '"auto", a noise model such as "student_t", or a list of noise models'),
    ({"deviation": "laws"}, 'it must be "auto", "none" or "law"'),
    ({"known": {"stifness": 20.0}}, "did you mean 'stiffness'"),
    ({"known": {"zeta": 0.1}}, "always inferred; give it a prior"),
    ({"known": {"noise_sd": 0.0}}, "must be a positive number"),
    ({"priors": {"viscous": 0.1}}, "must be one of Normal"),
    ({"priors": {"viscous": bd.Normal(0.0, 1.0)}}, "allows values below zero"),
    ({"priors": {"viscous": bd.HalfNormal(1.0), "zeta": bd.HalfNormal(1.0)}}, "is a second prior of zeta"),
    ({"priors": {"stiffness": bd.Normal(1.0, 1.0)}, "known": {"stiffness": 1.0}}, "or its prior, not both"),
    ({"deviation": "law", "sensor": -1.0}, "a number from 0 to below 0.5"),
    ({"deviation": "law", "priors": {"noise_sd": bd.HalfNormal(1.0)}}, "is not inferred under deviation"),
]


def test_misuse_is_refused_in_one_line() -> None:
    cases = [
        *((partial(bd.Model, **{"damping": "viscous", **options}), line) for options, line in REFUSED),
        (lambda: bd.HalfNormal(-1.0), "HalfNormal: scale is -1.0: input should be greater than 0"),
        (lambda: bd.Uniform(2.0, 1.0), r"Uniform: low \(2\) must be below high \(1\)"),
    ]
    assert not_refused(cases) == []
