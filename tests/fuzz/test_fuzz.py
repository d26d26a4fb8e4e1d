"""Damaged files, studies and command lines without end: `make fuzz`; a few of each in every run of the tests."""

from __future__ import annotations

import os
import tempfile
from functools import cache
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.bad_input import binaries
from tests.bad_input.case import Y, rows
from tests.bad_input.studies import GOOD
from tests.fuzz.damage import DAMAGES, WORDS, Edit, damaged
from tests.fuzz.judge import judge

EXAMPLES = int(os.environ.get("FUZZ_EXAMPLES", "0"))
FEW = settings(
    max_examples=EXAMPLES or 6,
    derandomize=not EXAMPLES,
    deadline=None,
    database=None,
    print_blob=False,
    suppress_health_check=list(HealthCheck),
)
LOGGER = (
    "# Logger 3, 2024-05-02T10:00:00Z\n# sample_rate: 50 Hz\n"
    "Time (s) Run #1;Angle (deg) Run #1;Time (s) Run #2;Angle (deg) Run #2\n"
    + "\n".join(f"{i / 50:.2f};{40 * y:.4f};{i / 50:.2f};{30 * y:.4f}" for i, y in enumerate(Y))
)
TEXTS = {
    "csv": None,
    "logger.csv": LOGGER.encode(),
    "txt": LOGGER.replace(".", ",").replace(";", "\t").encode(),
}
FORMS = (*TEXTS, *binaries.FORMATS)
OPTIONS = (
    "--time", "--angle", "--rate", "--unit", "--quantity", "--clock", "--time-unit", "--runs", "--channel", "--start",
    "--stop", "--none",
)  # fmt: skip
WORDS_OF_OPTIONS = st.sampled_from(
    ("1", "2", "0", "-1", "50", "nan", "angle", "time", "deg", "ms", "1-3", "", "-")
)
TEXT = st.text(st.characters(exclude_categories=("Cs",), exclude_characters="\0"), max_size=12)


@cache
def whole(form: str) -> bytes:
    """A faultless file of a format."""
    if TEXTS.get(form):
        return TEXTS[form] or b""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"a.{form}"
        (rows if form == "csv" else binaries.FORMATS[form])(path)
        return path.read_bytes()


@pytest.mark.parametrize("form", FORMS)
@FEW
@given(edits=DAMAGES)
def test_damaged_records(form: str, edits: list[Edit]) -> None:
    judge(("look", "FILE"), f"a.{form}", damaged(whole(form), edits))


@FEW
@given(edits=DAMAGES)
def test_damaged_studies(edits: list[Edit]) -> None:
    judge(("check", "FILE"), "a.toml", damaged(GOOD.encode(), edits))


@FEW
@given(given=st.lists(st.tuples(st.sampled_from(OPTIONS), WORDS_OF_OPTIONS | TEXT), min_size=1, max_size=4))
def test_any_options(given: list[tuple[str, str]]) -> None:
    judge(("look", "FILE", *(f"{option}={value}" for option, value in given)), "a.csv", whole("logger.csv"))


@FEW
@given(
    damping=st.from_regex(
        r"(viscous|coulomb|cubic|x)=[-0-9.e+]{0,8}(,quadratic=[0-9.e-]{0,5})?", fullmatch=True
    ),
    word=st.sampled_from([w.decode("latin-1") for w in WORDS if b"\0" not in w]) | st.integers().map(str),
    option=st.sampled_from(("--duration", "--samples", "--noise", "--seed", "--set")),
)
def test_any_simulation(damping: str, word: str, option: str) -> None:
    fixed = ("--restoring", "linear", "--set", "stiffness=20,rest_angle=0", "--samples", "300")
    judge(
        ("simulate", "--out", "b.csv", "--damping", damping, *fixed, f"{option}={word}"),
        made=("b.csv", "b.json", "b.csv.json"),
    )


def test_faultless_files_are_read() -> None:
    """Negative control: what the damage is done to, and damage that hits nothing."""
    for form in FORMS:
        nothing = damaged(whole(form), [Edit("remove", 1.0, 5, b"")])
        assert judge(("look", "FILE"), f"a.{form}", nothing) == 0, form


def test_a_command_that_fails_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """Negative control: an exit status or a page of words that is not owed."""
    monkeypatch.setattr("tests.fuzz.judge.main", lambda _: 1)
    with pytest.raises(AssertionError, match="exit 1"):
        judge(("look", "FILE"), "a.csv", whole("csv"))
