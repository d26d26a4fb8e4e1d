"""Damaged files, studies and command lines: many with `make fuzz`, a few of each in every run of the tests."""

import os

import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

from tests.bad_input import binaries
from tests.bad_input.case import T, Y, raw
from tests.bad_input.judge import judge
from tests.bad_input.studies import GOOD
from tests.fuzz.damage import DAMAGES, WORDS, Edit, damaged

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
    "csv": "\n".join(["time,angle", *(f"{t},{y}" for t, y in zip(T, Y))]).encode(),
    "logger.csv": LOGGER.encode(),
    "txt": LOGGER.replace(".", ",").replace(";", "\t").encode(),
    "toml": GOOD.encode(),
}
READS = {"toml": "check"}
"""The command that reads a form, if it is not `look`."""
FORMS = (*TEXTS, *binaries.FORMATS)
OPTIONS = (
    "--time", "--angle", "--rate", "--unit", "--quantity", "--clock", "--time-unit", "--runs", "--channel", "--start",
    "--stop", "--none",
)  # fmt: skip
WORDS_OF_OPTIONS = st.sampled_from(
    ("1", "2", "0", "-1", "50", "nan", "angle", "time", "deg", "ms", "1-3", "", "-")
)
TEXT = st.text(st.characters(exclude_categories=("Cs",), exclude_characters="\0"), max_size=12)


def whole(form: str) -> bytes:
    """Return the bytes of a file without a fault."""
    return TEXTS[form] if form in TEXTS else binaries.whole(form)


@pytest.mark.parametrize("form", FORMS)
@FEW
@given(edits=DAMAGES)
def test_a_damaged_record_or_study_is_read_or_refused_in_one_line(form: str, edits: list[Edit]) -> None:
    judge((READS.get(form, "look"), "FILE"), f"a.{form}", raw(damaged(whole(form), edits)))


@FEW
@given(given=st.lists(st.tuples(st.sampled_from(OPTIONS), WORDS_OF_OPTIONS | TEXT), min_size=1, max_size=4))
def test_any_options_are_valid_or_refused_in_one_line(given: list[tuple[str, str]]) -> None:
    judge(("look", "FILE", *(f"{option}={value}" for option, value in given)), write=raw(whole("logger.csv")))


@FEW
@given(
    damping=st.from_regex(
        r"(viscous|coulomb|cubic|x)=[-0-9.e+]{0,8}(,quadratic=[0-9.e-]{0,5})?", fullmatch=True
    ),
    word=st.sampled_from([w.decode("latin-1") for w in WORDS if b"\0" not in w]) | st.integers().map(str),
    option=st.sampled_from(("--duration", "--samples", "--noise", "--seed", "--set")),
)
def test_any_simulation_is_written_or_refused_in_one_line(damping: str, word: str, option: str) -> None:
    fixed = ("--restoring", "linear", "--set", "stiffness=20,rest_angle=0", "--samples", "300")
    judge(
        ("simulate", "--out", "b.csv", "--damping", damping, *fixed, f"{option}={word}"),
        may_write=("b.csv", "b.json", "b.csv.json"),
    )


def test_files_without_a_fault_are_read() -> None:
    """Control: an edit without an effect. Binary files without a fault are read in tests/bad_input."""
    for form in TEXTS:
        content = damaged(whole(form), [Edit("remove", 1.0, 5, b"")])
        judge((READS.get(form, "look"), "FILE"), f"a.{form}", raw(content), statuses=(0,))


def test_a_command_with_a_wrong_exit_status_is_detected(monkeypatch: pytest.MonkeyPatch) -> None:
    """Control of all tests that use `judge`."""
    monkeypatch.setattr("tests.bad_input.judge.main", lambda _: 1)
    with pytest.raises(AssertionError, match="exit 1"):
        judge(("look", "FILE"), write=raw(whole("csv")))
