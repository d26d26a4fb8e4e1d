"""The noise of a study's records: chosen once for all dampings, or refused in a sentence."""

from __future__ import annotations

import pytest

from bayesdamp.config import load_study
from bayesdamp.store import Store, read_table
from bayesdamp.study import cells, run_study
from bayesdamp.types import InputError

STUDY = """
version = 1
name = "noises"
seed = 5
[system]
restoring = "linear"
stiffness = 20.0
rest_angle = 0.0
theta0 = 0.3
omega0 = 0.0
[[signal]]
name = "noisy"
simulate = {{ viscous = 0.05, duration = 10.0, samples = 200, noise_sd = 0.003 }}
[estimators]
use = ["least_squares"]
[models]
compare = ["viscous"]
[posterior]
samplers = ["laplace"]
noise = {noise}
draws = 500
[evidence]
methods = []
"""


def study(folder, noise):
    file = folder / "noises.toml"
    file.write_text(STUDY.format(noise=noise), encoding="utf-8")
    return load_study(file)


def test_one_noise_is_chosen_and_shown(tmp_path):
    made = study(tmp_path, '["quantised", "gaussian"]')
    assert "noise/noisy/0" in [cell.name for cell in cells(made)]
    assert run_study(made, tmp_path / "out", workers=1) == 0
    store = Store(tmp_path / "out")
    found = store.read("noise/noisy/0")
    assert found.meta["chosen"] == "gaussian"
    assert "recording step" in found.meta["weighed"][0]["outcome"]
    assert read_table(tmp_path / "out" / "fits.csv")[0]["verdict"] == "fits"
    climbs = store.read("mode/noisy/0/viscous").meta["climbs"]
    assert [c["seed"] for c in climbs] == [
        "frequency and decay",
        "least_squares, initial",
        "least_squares, refined",
        "prior 1",
        "prior 2",
    ]
    assert all(c["mode"] == 0 for c in climbs[:3])
    report = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert 'id="noise"' in report
    assert 'id="seeds"' in report


def test_a_noise_that_is_none_for_the_record_is_refused(tmp_path):
    made = study(tmp_path, '"quantised"')
    assert run_study(made, tmp_path / "out", workers=1) == 0
    (row,) = read_table(tmp_path / "out" / "posteriors.csv")
    assert "recording step" in row["outcome"]


def test_all_noises_by_one_word(tmp_path):
    assert study(tmp_path, '"auto"').noises == ("correlated", "gaussian", "quantised", "student_t")


@pytest.mark.parametrize(
    ("noise", "said"),
    [
        ('"pink"', "pink"),
        ('["gaussian", "gaussian"]', "gaussian"),
        ("[]", "noise"),
        ("3", "a noise model's name in quotes"),
    ],
)
def test_wrong_noise_is_told(tmp_path, noise, said):
    with pytest.raises(InputError, match=said) as error:
        study(tmp_path, noise)
    assert "\n" not in str(error.value)
    assert "posterior.noise" in str(error.value)
