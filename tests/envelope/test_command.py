"""`bayesdamp compare` on envelopes: recognised, said, written; and one clear line for what is wrong."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bayesdamp.cli import main
from bayesdamp.records.envelope.reading import are_envelopes, is_envelope, read_envelope
from bayesdamp.records.envelope.record import unit_in
from bayesdamp.store import Store
from bayesdamp.types import InputError
from tests.envelope.ringdowns import Ringdown, simulate

HEAD = "% Frequency [Hz]: 1562325.84\n% Quality factor: 2.5e7\n%\n% time [s], power [dBm]\n"
DATA = Path(__file__).resolve().parents[2] / ".." / "shared" / "data" / "ringdown"


def written(path: Path, seed: int = 1, head: str = HEAD) -> Path:
    drawn = simulate(Ringdown({"viscous": 0.2}, drop=5.0, scatter=0.02), np.random.default_rng(seed))
    lines = [f"{t:.6g}, {y:.8g}" for t, y in zip(drawn.t, drawn.level)]
    path.write_text(head + "\n".join(lines) + "\n")
    return path


def test_a_sampling_frequency_is_not_the_oscillation_s(tmp_path):
    """The control: without that line the head says the same."""
    line = "% Sampling frequency [kHz]: 50\n"
    results = [
        read_envelope(written(tmp_path / f"{i}.txt", head=head)) for i, head in enumerate((line + HEAD, HEAD))
    ]
    assert [record.frequency for record in results] == [1562325.84, 1562325.84]
    alone = HEAD.replace("Frequency [Hz]", "Sampling frequency [Hz]")
    assert read_envelope(written(tmp_path / "alone.txt", head=alone)).frequency is None


def test_records_in_decibels_are_recognised_said_and_written(tmp_path, capsys):
    files = [written(tmp_path / f"r{k}.txt", k) for k in (1, 2)]
    out = tmp_path / "out"
    assert main(["compare", *map(str, files), "--repeats", "--out", str(out)]) == 0
    text = capsys.readouterr().out.splitlines()
    assert [line.partition(" (")[0] for line in text if " damping (prob" in line] == [
        "r1: Viscous damping",
        "r2: Viscous damping",
        "specimen: 2 records: Viscous damping",
    ]
    assert any("One more record would have Q = " in line for line in text)
    assert text[-1] == str(out / "report.html")
    verdicts = json.loads((out / "verdict.json").read_text())
    truth = np.pi * 1562325.84 / 0.2
    for item in verdicts[:2]:
        assert item["quality_factor"]["low"] <= truth <= item["quality_factor"]["high"]
        assert item["damping"] == "viscous"
        assert len(item["damping_ratio"]) == 3
        assert {"amplitude", "unit", "value", "sd_noise", "sd_law", "low", "high"} == set(
            item["damping_ratio"][0]
        )
        assert item["damping_ratio"][0]["value"] == pytest.approx(0.1 / (np.pi * 1562325.84), rel=0.1)
        assert {"start", "stop", "cycles", "why"} <= set(item["window"])
        assert any("states Q = " in line for line in item["remarks"])
    assert (verdicts[2]["record"], verdicts[2]["records"], verdicts[2]["quantity"]) == (
        "specimen",
        2,
        "envelope",
    )
    rows = list(csv.DictReader((out / "verdicts.csv").read_text().splitlines()))
    assert [row["record"] for row in rows] == ["r1", "r2", "specimen"]
    assert float(rows[0]["quality_factor"]) == verdicts[0]["quality_factor"]["value"]
    for key in ("r1", "r2"):
        assert (out / "figures" / f"answer-{key}.png").read_bytes().startswith(b"\x89PNG")
    page = (out / "report.html").read_text()
    assert page.count("data:image/png") == 2
    assert "Coulomb" in page


def test_names_with_marks_of_html_stay_text(tmp_path, capsys):
    files = [written(tmp_path / f"<{mark}>.txt", k) for k, mark in enumerate("iu")]
    out = tmp_path / "<b>"
    assert main(["compare", *map(str, files), "--repeats", "--out", str(out)]) == 0
    page = (out / "report.html").read_text(encoding="utf-8")
    assert all(f"&lt;{mark}&gt;.txt" in page for mark in "iu")
    assert not [mark for mark in "biu" if f"<{mark}>" in page]


def test_the_same_command_writes_the_same(tmp_path, capsys):
    file = written(tmp_path / "r.txt")
    for out in ("a", "b"):
        assert main(["compare", str(file), "--out", str(tmp_path / out)]) == 0
    for name in ("verdict.json", "verdicts.csv", "figures/answer-r.png"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def test_an_amplitude_is_an_envelope_where_one_says_so(tmp_path, capsys):
    t = np.arange(0.0, 120.0, 4.0)
    y = 2.0 * np.exp(-0.03 * t + 0.01 * np.random.default_rng(3).standard_normal(t.size))
    file = tmp_path / "swing.csv"
    file.write_text("time (s),amplitude (mm)\n" + "\n".join(f"{a},{b}" for a, b in zip(t, y)) + "\n")
    assert not is_envelope(file)
    out = tmp_path / "out"
    asked = ["compare", str(file), "--quantity", "envelope", "--frequency", "2", "--out", str(out)]
    assert main(asked) == 0
    content = json.loads((out / "verdict.json").read_text())[0]
    assert content["damping_ratio"][1]["unit"] == "mm"
    assert content["quality_factor"]["low"] <= np.pi * 2 / 0.03 <= content["quality_factor"]["high"]
    assert "swing: Viscous damping (probability 0.9" in capsys.readouterr().out


def test_a_record_without_decay_is_a_verdict_too(tmp_path, capsys):
    file = tmp_path / "flat.txt"
    noise = np.random.default_rng(1).standard_normal(300)
    file.write_text("time [s], level [dB]\n" + "\n".join(f"{k}, {v}" for k, v in enumerate(noise)) + "\n")
    assert main(["compare", str(file), "--out", str(tmp_path / "out")]) == 0
    assert json.loads((tmp_path / "out" / "verdict.json").read_text())[0]["grade"] == "no_free_decay"
    assert "flat: No free decay" in capsys.readouterr().out


def test_one_bad_file_of_several_is_named_and_the_others_are_answered(tmp_path, capsys):
    files = [written(tmp_path / f"r{k}.txt", k) for k in (1, 2, 3)]
    lines = files[1].read_text().splitlines()
    files[1].write_text("\n".join([*lines[:-1], f"{lines[-1].partition(',')[0]}, nan"]) + "\n")
    out = tmp_path / "out"
    assert main(["compare", *map(str, files), "--out", str(out)]) == 3
    text = capsys.readouterr()
    assert [line.partition(":")[0] for line in text.out.splitlines() if " damping (" in line] == ["r1", "r3"]
    assert (
        text.err.splitlines()[-1]
        == f"failed: r2.txt: line {len(lines)}: the value is nan, not a finite number; correct it or leave the row out"
    )
    assert len(json.loads((out / "verdict.json").read_text())) == 2


@pytest.mark.parametrize(
    ("more", "what"),
    [
        (["--frequency", "-3"], "must be positive, in Hz"),
        (["--start", "1e9"], "readings are between start and stop"),
        (["--repeats"], "there is one record"),
    ],
)
def test_what_is_wrong_is_one_line_and_nothing_is_written(tmp_path, capsys, more, what):
    file = written(tmp_path / "r.txt")
    out = tmp_path / "out"
    assert main(["compare", str(file), *more, "--out", str(out)]) == 2
    text = capsys.readouterr().err.strip().splitlines()
    assert len(text) == 1
    assert what in text[0]
    assert not out.exists()


def test_a_frequency_is_for_envelopes(tmp_path, capsys):
    file = tmp_path / "r.csv"
    file.write_text("t,angle\n0,1\n1,2\n")
    assert main(["compare", str(file), "--frequency", "3"]) == 2
    assert "--quantity envelope" in capsys.readouterr().err


def test_some_in_decibels_and_some_not_is_refused(tmp_path):
    other = tmp_path / "o.csv"
    other.write_text("t,angle (deg)\n0,1\n1,2\n")
    with pytest.raises(InputError, match="separate calls"):
        are_envelopes([written(tmp_path / "r.txt"), other], None, None, None)
    assert not are_envelopes([other], None, None, None)
    assert are_envelopes([other], None, None, "envelope")


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("power [dBm]", "dBm"),
        ("level / dB", "dB"),
        ("Power (mW)", "mW"),
        ("sound level in dBA", "dBA"),
        ("angle (deg)", None),
        ("time [s]", None),
        ("power (W)", "W"),
        ("rpm", None),
    ],
)
def test_units_in_names(name, unit):
    assert unit_in(name) == unit


def test_the_frequency_is_read_from_the_head(tmp_path):
    head = "# resonance frequency: 1.5 MHz\n# sampling rate: 100 Hz\n# time [s], power [dBm]\n"
    assert read_envelope(written(tmp_path / "r.txt", head=head)).frequency == pytest.approx(1.5e6)
    assert read_envelope(written(tmp_path / "q.txt", head="time [s], power [dBm]\n")).frequency is None


def test_repeats_of_measured_samples_agree_within_their_intervals():
    """Four ring-downs of one sample and two of another: pairs' standardised differences, and the Q that the authors of
    the records found, within 8 %."""
    if not DATA.exists():
        pytest.skip("the measured decays are not here")
    from bayesdamp.interface.envelopes import analyse
    from bayesdamp.verdict.envelope import specimen

    for sample, count in (("SP23-62", 4), ("0344", 2)):
        records = [read_envelope(path) for path in sorted(DATA.glob(f"*{sample}.txt"))]
        results = [analyse(record) for record in records]
        common = specimen(sample, results)
        assert common is not None
        assert common.records == count
        assert common.standardised < 3.0
        for record, item in zip(records, (answer.verdict for answer in results)):
            assert item.quality_factor is not None
            stated = float(record.facts["Quality factor"])
            assert item.quality_factor.value == pytest.approx(stated, rel=0.12 if count == 2 else 0.05)
            assert max(item.probabilities, key=item.probabilities.__getitem__) == "viscous"


def test_the_page_is_made_anew_and_nothing_is_computed(tmp_path, capsys):
    files = [written(tmp_path / f"r{k}.txt", k) for k in (1, 2)]
    flat = tmp_path / "flat.txt"
    flat.write_text("time [s], level [dB]\n" + "\n".join(f"{k}, {(7 * k) % 5}" for k in range(300)) + "\n")
    out = tmp_path / "out"
    assert main(["compare", *map(str, [*files, flat]), "--repeats", "--out", str(out)]) == 0
    page = (out / "report.html").read_bytes()
    overview = page.decode().split("</table>")[0]
    assert [overview.count(f'href="#answer-{name}"') for name in ("r1", "r2", "flat")] == [1, 1, 1]
    assert "Coulomb" in overview or "viscous" in overview
    (out / "report.html").unlink()
    capsys.readouterr()
    assert main(["report", str(out)]) == 0
    assert capsys.readouterr().out.strip() == str(out / "report.html")
    assert (out / "report.html").read_bytes() == page
    # Negative control: it is the stored answers that are shown.
    store = Store(out)
    cell = store.read("answer/r1/0")
    verdict = {**cell.meta["verdict"], "sentence": "Another sentence."}
    store.write(replace(cell, meta={**cell.meta, "verdict": verdict}))
    assert main(["report", str(out)]) == 0
    assert "Another sentence" in (out / "report.html").read_text()
    (out / "verdict.json").write_text("[{}, 3]")
    capsys.readouterr()
    assert main(["report", str(out)]) == 2
    assert "not a file that a run wrote" in capsys.readouterr().err


def test_a_users_own_files_are_not_replaced(tmp_path, capsys):
    """Neither a table that no run wrote, nor what a link leads to; the control is a folder that a run made."""
    record, out = written(tmp_path / "r.txt", 1), tmp_path / "out"
    out.mkdir()
    (out / "verdicts.csv").write_text("mine")
    assert main(["compare", str(record), "--out", str(out)]) == 2
    assert "no run of bayesdamp wrote" in capsys.readouterr().err
    assert (out / "verdicts.csv").read_text() == "mine"
    (out / "verdicts.csv").unlink()
    (tmp_path / "elsewhere").mkdir()
    (out / "figures").symlink_to(tmp_path / "elsewhere")
    assert main(["compare", str(record), "--out", str(out)]) == 2
    assert not list((tmp_path / "elsewhere").iterdir())
    (out / "figures").unlink()
    for _ in range(2):
        assert main(["compare", str(record), "--out", str(out)]) == 0


def test_a_level_that_none_has_is_refused(tmp_path, capsys):
    """The control is one of 900 dB, which is strange and can be computed with."""
    file, out = tmp_path / "r.txt", tmp_path / "out"
    rng = np.random.default_rng(1)
    for loud, status in ((1e5, 2), (-1e5, 2), (900.0, 0)):
        level = rng.choice([0.0, -300.0, loud, 1e-300], 100)
        lines = (f"{k},{y:g}" for k, y in enumerate(level))
        file.write_text("time,level [dB]\n" + "\n".join(lines) + "\n")
        assert main(["compare", str(file), "--quantity", "envelope", "--out", str(out)]) == status
        text = capsys.readouterr()
        if status:
            assert (
                text.err
                == f"r.txt: a level of {loud:g} dB is beyond any instrument's; is it the right column, and in dB?\n"
            )
            assert not out.exists()
        else:
            assert "No free decay" in text.out


def test_readings_that_are_next_to_nothing_are_zeros(tmp_path, capsys):
    t = np.arange(150.0)
    y = np.exp(-0.05 * t)
    for name, small in (("zero", 0.0), ("tiny", 1e-200)):
        y[::7] = small
        rows = (f"{a},{b:g}" for a, b in zip(t, y))
        (tmp_path / name).mkdir()
        (tmp_path / name / "r.csv").write_text("time (s),amplitude (V)\n" + "\n".join(rows) + "\n")
        asked = ["compare", str(tmp_path / name / "r.csv"), "--quantity", "envelope"]
        assert main([*asked, "--out", str(tmp_path / name / "out")]) == 0
    zero, tiny = ((tmp_path / name / "out" / "verdict.json").read_text() for name in ("zero", "tiny"))
    assert zero == tiny
    assert "22 readings that are zero" in zero


def test_two_questions_do_not_share_a_folder(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "other").mkdir()
    asked = [
        [str(written(tmp_path / "r.txt"))],
        [str(written(tmp_path / "other" / "r.txt", 2))],
        [str(tmp_path / "r.txt"), "--frequency", "2e6"],
        [str(tmp_path / "r.txt")],
    ]
    places = []
    for more in asked:
        assert main(["compare", *more]) == 0
        text = capsys.readouterr()
        places.append(text.out.splitlines()[-1].split("/")[1])
        assert ("another question" in text.err) == (places[-1] != "r")
    assert places == ["r", "r-2", "r-3", "r"]


def test_many_records_in_two_processes_are_those_of_one(tmp_path, capsys):
    t = np.arange(0.0, 120.0, 4.0)
    for k in range(8):
        y = 2.0 * np.exp(-(0.02 + 0.002 * k) * t + 0.01 * np.random.default_rng(k).standard_normal(t.size))
        text = "\n".join(f"{a},{b}" for a, b in zip(t, y))
        (tmp_path / f"r{k}.csv").write_text("time (s),amplitude (mm)\n" + text + "\n")
    files = [str(tmp_path / f"r{k}.csv") for k in range(8)]
    for workers in "12":
        more = ["--quantity", "envelope", "--workers", workers, "--out", str(tmp_path / workers)]
        assert main(["compare", *files, *more]) == 0
    first, two = (
        list(csv.DictReader((tmp_path / w / "verdicts.csv").read_text().splitlines())) for w in "12"
    )
    assert [row["record"] for row in two] == [f"r{k}" for k in range(8)]
    for a, b in zip(first, two):
        assert float(a["rate"]) == pytest.approx(float(b["rate"]), rel=1e-6)
        assert a["damping"] == b["damping"]
    assert len(list((tmp_path / "2" / "figures").glob("*.png"))) == 8


@pytest.mark.parametrize("option", [("--noise", "white"), ("--restoring", "linear"), ("--exact",)])
def test_an_option_that_no_envelope_is_answered_by_is_refused(tmp_path, capsys, option):
    assert main(["compare", str(written(tmp_path / "r.txt")), *option, "--out", str(tmp_path / "out")]) == 2
    assert capsys.readouterr().err.startswith(f"{option[0]}: does not apply to envelope")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(("low", "hinted"), [(0.0, True), (-1e-9, False)])
def test_amplitudes_that_are_not_said_to_be_an_envelope_are_hinted_at(tmp_path, capsys, low, hinted):
    """The control: a reading below zero is none of an amplitude."""
    file = tmp_path / "r.csv"
    t = np.linspace(0, 60, 400)
    y = np.maximum(np.exp(-0.05 * t), 1e-3)
    y[-1] = low
    np.savetxt(file, np.column_stack([t, y]), delimiter=",", header="time,R (V)", comments="")
    assert main(["compare", str(file), "--out", str(tmp_path / "out")]) == 2
    assert ("--quantity envelope" in capsys.readouterr().err) == hinted


def test_viscous_damping_of_an_envelope_may_be_structural(tmp_path, capsys):
    assert main(["compare", str(written(tmp_path / "r.txt")), "--out", str(tmp_path / "out")]) == 0
    (item,) = json.loads((tmp_path / "out" / "verdict.json").read_text())
    assert any("structural" in line for line in item["remarks"])
    assert item["damping"] == "viscous"
