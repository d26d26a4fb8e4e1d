"""The tasks of studies with several records of a specimen, and records that cannot be joined."""

import numpy as np
import pytest

from bayesdamp.config.load import SPECIMEN, comparison_study
from bayesdamp.pipeline.jobs import task_names
from bayesdamp.types import InputError
from tests.records.tables import write_table
from tests.studies import signal_text, study_text

KEYS = (
    'estimators = { use = ["least_squares"] }',
    'models = { compare = ["viscous"] }',
    'posterior = { samplers = [] }\nevidence = { methods = ["importance"] }',
)
SYSTEM = 'restoring = "linear", stiffness = 20.0, rest_angle = 0.0, theta0 = "free", omega0 = 0.0'
RECORDS = [("a1", 0.05, 0.3), ("a2", 0.05, 0.25), ("b1", 0.06, 0.3), ("b2", 0.09, 0.3), ("c", 0.04, 0.3)]


def text_of(records=RECORDS) -> str:
    """Return the text of a study of these records: name (it begins with the specimen), damping and initial angle."""
    known = "duration = 8.0, samples = 240, noise_sd = 0.003"
    first, *others = (
        {"name": name, "specimen": name[0], "simulate": f"viscous = {viscous}, theta0 = {start}, {known}"}
        for name, viscous, start in records
    )
    text = study_text(*KEYS, system=SYSTEM, seed=5, **first)
    return text + "".join(signal_text(**other) for other in others)


SWEEP = '[[sweep]]\nkey = "simulate.noise_sd"\nvalues = [0.003]\n'
WRONG = [
    ('specimen = "a"', "specimen = 3", "it must be a name in quotes"),
    ("theta0 = 0.25", 'theta0 = 0.25, unit = "m"', "in m and rad"),
    ('name = "a2"\n', 'name = "a2"\ncompare = ["quadratic"]\n', "compare different models"),
    ('[[signal]]\nname = "a2"', f'{SWEEP}[[signal]]\nname = "a2"', "[[sweep]]"),
]


def test_records_that_cannot_be_joined_are_refused_in_one_line(tmp_path, refused):
    for old, new, line in WRONG:
        (tmp_path / "wrong.toml").write_text(text_of(RECORDS[:2]).replace(old, new), encoding="utf-8")
        assert line in refused("check", str(tmp_path / "wrong.toml"))


@pytest.fixture
def files(tmp_path) -> list[dict[str, str]]:
    """Two files, as keys of signals."""
    t = np.arange(50) / 50
    paths = [write_table(tmp_path / f"{name}.csv", "t,angle", t, 0.3 - 0.1 * (50 * t % 5)) for name in "ab"]
    return [{"file": str(path), "time": "t", "angle": "angle"} for path in paths]


def test_compare_reads_files_as_specimens_or_as_repeats(files, tmp_path, refused):
    runs = [{**record, "specimen": "my rig"} for record in files]
    assert set(comparison_study(runs).specimens) == {"my_rig"}
    assert set(comparison_study(files, repeats=True).specimens) == {SPECIMEN}
    assert not comparison_study(files).specimens
    same = [files[0], {**files[0], "file": str(tmp_path / "." / "a.csv")}]
    units = [{**record, "unit": unit} for record, unit in zip(files, ("mm", "deg"), strict=True)]
    for records, line in (
        (files[:1], "two or more of one specimen"),
        (same, r"--repeats: .* are the same record"),
        (units, r"^--repeats: signals b and a are of one specimen, .* in deg and mm; "),
    ):
        with pytest.raises(InputError, match=line):
            comparison_study(records, repeats=True)
    assert refused("compare", files[0]["file"], "--repeats").startswith("--repeats: there is one record")


def test_repeats_have_the_same_tasks_as_other_records(files):
    alone, repeated = (task_names(comparison_study(files, repeats=repeats)) for repeats in (False, True))
    assert alone == repeated
