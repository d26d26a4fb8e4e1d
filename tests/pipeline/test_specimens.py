"""What a study and `compare` say of specimens, before anything is computed."""

from __future__ import annotations

from pathlib import Path

import pytest

from bayesdamp.config import load_study
from bayesdamp.config.compare import SPECIMEN, comparison
from bayesdamp.pipeline.jobs import task_names
from bayesdamp.types import InputError
from tests.studies import signal_text, study_text

KEYS = (
    'estimators = { use = ["least_squares"] }',
    'models = { compare = ["viscous"] }',
    'posterior = { samplers = [] }\nevidence = { methods = ["importance"] }',
)
SYSTEM = 'restoring = "linear", stiffness = 20.0, rest_angle = 0.0, theta0 = "free", omega0 = 0.0'
RECORDS = [
    ("a1", "a", 0.05, 0.3),
    ("a2", "a", 0.05, 0.25),
    ("b1", "b", 0.06, 0.3),
    ("b2", "b", 0.09, 0.3),
    ("c", "c", 0.04, 0.3),
]


def write(folder: Path, records=RECORDS) -> Path:
    known = "duration = 8.0, samples = 240, noise_sd = 0.003"
    first, *others = (
        {"name": name, "specimen": specimen, "simulate": f"viscous = {viscous}, theta0 = {start}, {known}"}
        for name, specimen, viscous, start in records
    )
    file = folder / "many.toml"
    text = study_text(*KEYS, system=SYSTEM, seed=5, **first) + "".join(
        signal_text(**other) for other in others
    )
    file.write_text(text, encoding="utf-8")
    return file


def test_cells_are_listed(tmp_path):
    names = set(task_names(load_study(write(tmp_path))))
    assert {"joint/a", "joint/b", "population/specimens"} <= names
    assert "joint/c" not in names


WRONG = [
    ('specimen = "a"', "specimen = 3", "it must be a name in quotes"),
    ("theta0 = 0.25", 'theta0 = 0.25, unit = "m"', "in m and rad"),
    ('name = "a2"\n', 'name = "a2"\ncompare = ["quadratic"]\n', "under other models"),
    (
        '[[signal]]\nname = "a2"',
        '[[sweep]]\nkey = "simulate.noise_sd"\nvalues = [0.003]\n[[signal]]\nname = "a2"',
        "[[sweep]]",
    ),
]


def test_what_cannot_be_joined_is_one_line(tmp_path, refused):
    text = write(tmp_path, RECORDS[:2]).read_text(encoding="utf-8")
    for old, new, said in WRONG:
        (tmp_path / "wrong.toml").write_text(text.replace(old, new), encoding="utf-8")
        assert said in refused("check", str(tmp_path / "wrong.toml"))


def test_compare_takes_records_as_specimens_or_as_repeats(tmp_path, refused):
    paths = [tmp_path / "a.csv", tmp_path / "b.csv"]
    for path in paths:
        path.write_text(
            "t,angle\n" + "\n".join(f"{i / 50},{0.3 - 0.1 * (i % 5)}" for i in range(50)), encoding="utf-8"
        )
    asked = [{"file": str(p), "time": "t", "angle": "angle"} for p in paths]
    assert set(comparison(asked).specimens) == {"a", "b"}
    together = comparison(asked, repeats=True)
    assert set(together.specimens) == {SPECIMEN}
    assert not comparison(asked[:1]).specimens
    with pytest.raises(InputError, match="two or more of one specimen"):
        comparison(asked[:1], repeats=True)
    with pytest.raises(InputError, match=r"--repeats: .* are the same record"):
        comparison([asked[0], {**asked[0], "file": str(tmp_path / "." / "a.csv")}], repeats=True)
    in_units = [{**record, "unit": unit} for record, unit in zip(asked, ("mm", "deg"), strict=True)]
    with pytest.raises(
        InputError, match=r"^--repeats: signals b and a are of one specimen, .* in deg and mm; "
    ):
        comparison(in_units, repeats=True)
    assert refused("compare", str(paths[0]), "--repeats").startswith("--repeats: there is one record")


def test_of_repeats_no_record_is_sampled_by_itself(tmp_path):
    """Negative control: records that stand each for itself have draws, and are predicted from their halves."""
    asked = [{"file": str(tmp_path / f"{name}.csv"), "time": "t", "angle": "angle"} for name in "ab"]
    for one in asked:
        Path(one["file"]).write_text("t,angle\n0,0\n", encoding="utf-8")
    for repeats, wanted in ((True, set()), (False, {"posterior", "bridge", "half", "noises"})):
        tasks = task_names(comparison(asked, repeats=repeats))
        parts = {part for name in tasks for part in name.split("/")}
        assert parts & {"mode", "importance", "posterior", "bridge", "half", "noises"} == {
            "mode", "importance", *wanted
        }  # fmt: skip
