"""The answers on fixed records, frozen as data, and how far today's answers are from them.

    python -m tests.reference.frozen freeze [NAME ...]
    python -m tests.reference.frozen compare [NAME ...]

A name is that of a record or of a set: `simulated`, `envelopes`, `measured`. Records are simulated by the validation's
own solver, with their truth, and no part of the program that answers takes part in making them; `measured` needs the
data folder. `compare` prints each record whose answer has moved, and ends with status 1 where there is one.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from functools import cache
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from bayesdamp.interface.answer import answer
from bayesdamp.interface.envelopes import analyse
from bayesdamp.records.envelope.record import make_record
from bayesdamp.types import Signal
from validation.experiments.laws import case
from validation.measured.run import signals
from validation.truth import discrepancies, records
from validation.truth.drawing import Draw, draw_oscillator
from validation.truth.motion import NoMotionError, solve_motion
from validation.truth.oscillator import LAWS, SUMS
from validation.truth.ratio import RatioCurve, ratio_curve
from validation.truth.ringdowns import draw_ringdown, simulate

FOLDER = Path(__file__).with_name("answers")
SEED = 20261126
SUMS_OF_THREE, FORMS, DISCREPANT, ENVELOPES = 160, 4, 20, 20
"""Records of damping sums, of each other form, with a discrepancy, and ring-downs."""
SAMPLED = 8
"""One in so many simulated records is answered with sampling too."""
QUANTITIES = ("angle", "angle", "angle", "velocity", "acceleration")
NOISES = ("white", "white", "white", "correlated", "outliers", "step", "growing", "none")
OTHER_FORMS = ("cubic", "displacement", "power", "stribeck", "structural")
NEAR = 10.0
"""Nats behind the first candidate up to which evidence is compared."""
MOVED, NATS = 0.03, 0.05
"""What counts as moved: an end of an interval by this share of its width, evidence by so many nats."""
WORKERS = 2


@dataclass(frozen=True)
class Record:
    """A record, what is true of it, and its true damping ratio at an amplitude where that is known."""

    name: str
    signal: Signal
    truth: Mapping[str, Any] = field(default_factory=dict)
    ratio: RatioCurve | None = None


def sum_of_terms(number: int) -> Record:
    """A record of a sum of viscous, Coulomb and quadratic damping: every law, quantity and kind of noise in turn."""
    rng = np.random.default_rng([SEED, number])
    damping, law = SUMS[number % len(SUMS)], list(LAWS)[number % len(LAWS)]
    quantity, noise = QUANTITIES[number % len(QUANTITIES)], NOISES[number % len(NOISES)]
    while True:
        draw = draw_oscillator(rng, damping, law)
        try:
            end = draw.begin + draw.duration
            motion = solve_motion(draw.oscillator, draw.displacement, draw.frequency, end)
            break
        except NoMotionError:
            continue
    count = int(min(draw.cycles * draw.per_cycle, 6000))
    t = np.linspace(0.0, draw.duration, count)
    x, v = motion.at(draw.begin + t)
    pull = draw.oscillator.acceleration()
    clean = {"angle": x, "velocity": v}.get(quantity)
    if clean is None:
        clean = np.array([pull(*state, np.sign(state[2])) for state in zip(t, x, v, strict=True)])
    y = clean + _noise(rng, noise, draw, clean, count)
    unit = "m" if law in ("linear", "duffing") and number % 3 == 0 else "rad"
    name = f"sum-{number:03d}"
    signal = Signal(t, y, name=name, unit=unit, quantity=quantity)
    truth = {"damping": damping, "restoring": law, "quantity": quantity, "noise": noise}
    return Record(name, signal, truth, ratio_curve(motion, draw.oscillator.potential()))


def _noise(rng: np.random.Generator, kind: str, draw: Draw, clean: np.ndarray, count: int) -> np.ndarray:
    """Return errors of a kind, (n,), in the unit of the clean record (n,)."""
    size = float(np.ptp(clean)) / 2
    sd = draw.noise * size
    white = sd * rng.standard_normal(count)
    match kind:
        case "none":
            return 1e-3 * white
        case "correlated":
            keep = float(np.exp(-10 * draw.cycles / count))  # a tenth of a period
            found, last = np.empty(count), white[0]
            for i, one in enumerate(white):
                found[i] = last = keep * last + np.sqrt(1 - keep**2) * one
            return found
        case "outliers":
            hit = rng.random(count) < 0.02
            return white + hit * 0.3 * size * rng.standard_normal(count)
        case "step":
            step = 0.04 * size
            return step * np.round((clean + white) / step) - clean
        case "growing":
            return white * (0.3 + np.abs(clean) / size)
        case _:
            return white


@cache
def simulated_names() -> dict[str, tuple[str, int]]:
    """Return what makes each simulated record, by name: the kind and the number of its draw."""
    found = {f"sum-{i:03d}": ("sum", i) for i in range(SUMS_OF_THREE)}
    kinds = list(discrepancies.KINDS)
    others = [(form, i) for form in OTHER_FORMS for i in range(FORMS)]
    others += [(kinds[i % len(kinds)], i // len(kinds)) for i in range(DISCREPANT)]
    return found | {f"{kind}-{i}": (kind, i) for kind, i in others}


def simulated(name: str) -> Record:
    """Return the simulated record of a name."""
    kind, number = simulated_names()[name]
    if kind == "sum":
        return sum_of_terms(number)
    if kind in OTHER_FORMS:
        made = case(kind, SEED + number)
        return Record(name, made.signal, {"damping": made.damping, "restoring": "linear"})
    one = records.case(kind, SEED, number)
    return Record(name, one.signal, {"damping": one.damping, "restoring": one.restoring}, one.ratio)


def answered(record: Record, sample: bool) -> dict[str, Any]:
    """Return what is frozen of the answer on a record."""
    found = answer(record.signal, sample=sample, measured=not record.truth)
    verdict = found.verdict
    logs = {
        f"{c.damping}@{c.restoring}": c.exact if c.log_evidence is None else c.log_evidence
        for c in (*found.content.candidates, *found.content.rivals)
        if np.isfinite(c.exact)
    }
    top = max(logs.values(), default=0.0)
    row = {
        "grade": str(verdict.grade),
        "damping": verdict.damping,
        "probability": _digits(verdict.probability),
        "decided": verdict.decided,
        "restoring": verdict.restoring,
        "ratios": [
            [_digits(d.amplitude), *map(_digits, (d.value, d.low, d.high))] for d in verdict.damping_ratio
        ],
        "frequency": None
        if verdict.frequency is None
        else [_digits(n) for n in (verdict.frequency.value, verdict.frequency.low, verdict.frequency.high)],
        "evidence": {
            n: round(log - top, 4) for n, log in sorted(logs.items(), key=lambda i: -i[1]) if log > top - 2 * NEAR
        },
    }  # fmt: skip
    if record.ratio is not None:
        row["true_ratios"] = [_true(record.ratio, d.amplitude) for d in verdict.damping_ratio]
    return row


def _true(curve: RatioCurve, amplitude: float) -> float | None:
    try:
        return _digits(curve(amplitude))
    except ValueError:
        return None


def _digits(value: float) -> float:
    return float(f"{value:.8g}")


def simulated_row(name: str) -> dict[str, Any]:
    """Return what is frozen of a simulated record."""
    record = simulated(name)
    row = {"truth": dict(record.truth), "quick": answered(record, sample=False)}
    if list(simulated_names()).index(name) % SAMPLED == 0:
        row["sampled"] = answered(record, sample=True)
    return row


def envelope_row(name: str) -> dict[str, Any]:
    """Return what is frozen of a ring-down."""
    rng = np.random.default_rng([SEED, int(name.split("-")[1])])
    made = draw_ringdown("harsh", rng)
    truth = simulate(made, rng)
    result = analyse(make_record(name, truth.t, truth.level, "dBm", 1e6)).verdict
    row: dict[str, Any] = {"grade": str(result.grade), "damping": result.damping}
    if result.rate is not None:
        spans = [result.rate, *result.decay_rate]
        row["ratios"] = [[0.0, *map(_digits, (s.value, s.low, s.high))] for s in spans]
    return {"truth": {"damping": "+".join(made.rates)}, "quick": row}


def measured_rows() -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield what is frozen of each measured record."""
    for name, found in signals():
        for number, one in enumerate(found, start=1):
            yield f"{name}-{number}", {"quick": answered(Record(name, one), sample=False)}


def path_of(group: str) -> Path:
    """Return where a set is kept."""
    return FOLDER / f"{group}.json"


def frozen(group: str) -> dict[str, Any]:
    """Return the frozen answers of a set, by record; none where there is no file."""
    path = path_of(group)
    return json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}


def write(group: str, rows: Mapping[str, Any]) -> None:
    """Write a set, a line a record."""
    FOLDER.mkdir(exist_ok=True)
    lines = ",\n".join(f"{json.dumps(n)}: {json.dumps(row)}" for n, row in sorted(rows.items()))
    path_of(group).write_text("{\n" + lines + "\n}\n", encoding="utf-8")


def rows_of(group: str, names: Sequence[str]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Answer records of a set again, those of these names or all."""
    if group == "measured":
        yield from (pair for pair in measured_rows() if not names or pair[0] in names)
        return
    every, one_row = list(simulated_names()), simulated_row
    if group == "envelopes":
        every, one_row = [f"ringdown-{i:02d}" for i in range(ENVELOPES)], envelope_row
    chosen = [n for n in every if not names or n in names]
    with ProcessPoolExecutor(WORKERS, mp_context=get_context("spawn")) as pool:
        yield from zip(chosen, pool.map(one_row, chosen), strict=True)


def differences(before: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """Return in words what has moved between two answers on one record."""
    changed = (key for key in ("grade", "damping") if before[key] != now[key])
    found = [f"{key} {before[key]!r} -> {now[key]!r}" for key in changed]
    for was, is_ in zip(before.get("ratios", ()), now.get("ratios", ()), strict=False):
        found += _ends(f"ratio at {was[0]:.3g}", was[1:], is_[1:])
    if before.get("frequency") and now.get("frequency"):
        found += _ends("frequency", before["frequency"], now["frequency"])
    elif before.get("frequency") != now.get("frequency"):
        found.append(f"frequency {before.get('frequency')} -> {now.get('frequency')}")
    evidence = now.get("evidence", {})
    for name, log in before.get("evidence", {}).items():
        if log > -NEAR and name not in evidence:
            found.append(f"{name} is no longer weighed")
        elif log > -NEAR and abs(evidence[name] - log) > NATS:
            found.append(f"evidence of {name} {log:.2f} -> {evidence[name]:.2f}")
    return found


def _ends(what: str, was: Sequence[float], is_: Sequence[float]) -> list[str]:
    width = max(was[2] - was[1], 1e-12 * abs(was[0]))
    moved = max(abs(is_[i] - was[i]) for i in (1, 2)) / width
    return [f"{what} moved by {100 * moved:.0f} % of its width"] if moved > MOVED else []


def compared(group: str, names: Sequence[str] = ()) -> dict[str, list[str]]:
    """Return what has moved, by record and kind of answer, in a set or some of its records."""
    before = frozen(group)
    found = {}
    for name, row in rows_of(group, names):
        for kind in ("quick", "sampled"):
            if kind in row and kind in before.get(name, {}):
                found[f"{name} {kind}"] = differences(before[name][kind], row[kind])
    return found


def main(task: str, names: Sequence[str]) -> int:
    """Freeze or compare; returns the exit status."""
    groups = ("simulated", "envelopes", "measured")
    wanted = [g for g in groups if g in names or not names or not set(names) & set(groups)]
    single = [n for n in names if n not in groups]
    moved = 0
    for group in wanted:
        if task == "freeze":
            rows = frozen(group)
            for name, row in rows_of(group, single):
                print(name, row["quick"]["grade"], row["quick"]["damping"], flush=True)
                write(group, rows := {**rows, name: row})
            continue
        found = compared(group, single)
        leads = sum("damping" in " ".join(said).split() for said in found.values())
        for name, said in found.items():
            if said:
                print(f"{name}: {'; '.join(said)}", flush=True)
        now_moved = sum(map(bool, found.values()))
        moved += now_moved
        print(f"{group}: {len(found)} answers, {now_moved} moved, {leads} with another lead")
    return 1 if moved else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], sys.argv[2:]))
