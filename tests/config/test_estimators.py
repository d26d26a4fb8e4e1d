"""The estimators that a study names: variants, their options, and numbers of repeats."""

from pathlib import Path

import pytest

from bayesdamp.config import load_study
from bayesdamp.types import InputError
from tests.config.studies import GOOD, VARIANT, write


def test_an_estimator_runs_under_a_second_name_with_other_options(tmp_path: Path) -> None:
    study = load_study(write(tmp_path, GOOD + VARIANT))
    assert study.estimators.use == ("sindy", "by_sign")
    assert [study.estimators.method(name) for name in study.estimators.use] == ["sindy", "sindy"]
    switches = [study.estimator_options(name).model_dump()["switch"] for name in study.estimators.use]
    assert switches == ["tanh", "sign"]


def test_a_variant_s_wrong_option_is_reported_under_its_own_name(tmp_path: Path) -> None:
    study = load_study(write(tmp_path, GOOD + VARIANT.replace('"sign"', '"sgn"')))
    with pytest.raises(InputError, match=r"\[estimators\.by_sign\] switch = 'sgn'"):
        study.estimator_options("by_sign")


def test_the_number_of_repeats_of_an_estimator_can_be_limited(tmp_path: Path) -> None:
    text = GOOD + '[estimators]\nuse = ["envelope", "least_squares"]\nrepeats = { envelope = 2 }\n'
    use = load_study(write(tmp_path, text)).estimators
    assert [use.on(r) for r in (0, 1, 2)] == [("envelope", "least_squares")] * 2 + [("least_squares",)]
