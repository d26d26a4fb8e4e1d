"""The estimators that a study names: options, variants, repeats; and that the others are not imported."""

from __future__ import annotations

from pathlib import Path

import pytest

from bayesdamp.config import load_study
from bayesdamp.types import InputError
from tests.config.studies import GOOD, fault, write

VARIANT = (
    '[estimators]\nuse = ["sindy", "by_sign"]\n[estimators.by_sign]\nvariant_of = "sindy"\nswitch = "sign"\n'
)


def test_options_of_an_estimator_are_checked_when_asked_for(tmp_path: Path) -> None:
    study = load_study(write(tmp_path, GOOD + "[estimators.least_squares]\nvarant = 3\n"))
    with pytest.raises(InputError, match=r"study\.toml: .*varant.*did you mean 'variant'"):
        study.estimator_options("least_squares")
    assert study.estimator_options("envelope") is not None


def test_an_estimator_runs_under_a_second_name_with_other_options(tmp_path: Path) -> None:
    study = load_study(write(tmp_path, GOOD + VARIANT))
    assert study.estimators.use == ("sindy", "by_sign")
    assert [study.estimators.method(name) for name in study.estimators.use] == ["sindy", "sindy"]
    switches = [study.estimator_options(name).model_dump()["switch"] for name in study.estimators.use]
    assert switches == ["tanh", "sign"]


def test_wrong_variants(tmp_path: Path) -> None:
    for line, changed, expected in (
        ('"sindy"\nswitch', '"sindi"\nswitch', "estimators.by_sign.variant_of: unknown estimator 'sindi'"),
        (
            '"sindy"\nswitch',
            "3\nswitch",
            "estimators.by_sign.variant_of: is 3; it must be an estimator's name",
        ),
        ("[estimators.by_sign]", "[estimators.koopman]", "estimators.koopman: is the name of an estimator"),
        ('variant_of = "sindy"\n', "", "by_sign"),
    ):
        assert expected in fault(tmp_path, GOOD + VARIANT.replace(line, changed))


def test_a_variant_s_wrong_option_is_told_under_its_own_name(tmp_path: Path) -> None:
    study = load_study(write(tmp_path, GOOD + VARIANT.replace('"sign"', '"sgn"')))
    with pytest.raises(InputError, match=r"\[estimators\.by_sign\] switch = 'sgn'"):
        study.estimator_options("by_sign")


def test_a_method_runs_on_so_many_repeats_at_most(tmp_path: Path) -> None:
    text = GOOD + '[estimators]\nuse = ["envelope", "least_squares"]\nrepeats = { envelope = 2 }\n'
    use = load_study(write(tmp_path, text)).estimators
    assert [use.on(r) for r in (0, 1, 2)] == [("envelope", "least_squares")] * 2 + [("least_squares",)]
    wrong = text.replace("envelope = 2", "envelop = 2")
    assert fault(tmp_path, wrong).startswith(
        "estimators.repeats.envelop: unknown key; did you mean 'envelope'?"
    )
