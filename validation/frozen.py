"""Answers on fixed records, stored as data, and the differences between them and the answers of today.

    python -m validation.frozen freeze [NAME ...]
    python -m validation.frozen compare [NAME ...]

A name is that of a record or a group: `simulated`, `envelopes`, `measured`. Records are simulated by the validation's
own solver, without the program that answers. The group `measured` needs the data folder. `compare` prints each record
whose answer has changed, and ends with status 1 if there is one.
"""

import json
import sys
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from bayesdamp.interface.answer import answer, compare_models
from bayesdamp.interface.envelopes import analyse
from bayesdamp.records.envelope.record import make_record
from bayesdamp.types import Signal
from validation.experiments.laws import case
from validation.measured.run import DATA, signals
from validation.truth import discrepancies, records
from validation.truth.drawing import Draw, draw_oscillator
from validation.truth.motion import NoMotionError, solve_motion
from validation.truth.oscillator import LAWS, SUMS
from validation.truth.ringdowns import draw_ringdown, simulate

FOLDER = Path(__file__).with_name("frozen_answers")
SEED = 20261126
SUMS_OF_THREE, FORMS, DISCREPANT, ENVELOPES = 160, 4, 20, 20
"""Numbers of records with sums of damping terms, with each other form and with discrepancies, and of ring-downs."""
SAMPLED = 8
"""One in so many simulated records is also answered with sampling."""
QUANTITIES = ("angle", "angle", "angle", "velocity", "acceleration")
NOISES = ("white", "white", "white", "correlated", "outliers", "step", "growing", "none")
OTHER_FORMS = ("cubic", "displacement", "power", "stribeck", "structural")
NEAR = 10.0
"""Evidence is compared for candidates that are at most so many nats behind the first."""
MOVED, NATS = 0.03, 0.05
"""Smallest changes that are reported: of an end of an interval as a share of its width, of evidence in nats."""
WORKERS = 2


def sum_of_terms(number: int) -> Signal:
    """Return a record of a sum of viscous, Coulomb and quadratic damping. Laws, quantities and noises alternate."""
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
    if quantity == "acceleration":
        acceleration = draw.oscillator.acceleration()
        clean = np.array([acceleration(*state, np.sign(state[2])) for state in zip(t, x, v, strict=True)])
    else:
        clean = x if quantity == "angle" else v
    y = clean + _noise(rng, noise, draw, clean, count)
    unit = "m" if law in ("linear", "duffing") and number % 3 == 0 else "rad"
    return Signal(t, y, name=f"sum-{number:03d}", unit=unit, quantity=quantity)


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
            noise, last = np.empty(count), white[0]
            for i, value in enumerate(white):
                noise[i] = last = keep * last + np.sqrt(1 - keep**2) * value
            return noise
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
    """Return the kind and the number of the draw of each simulated record, by name."""
    kinds = list(discrepancies.KINDS)
    others = [(form, i) for form in OTHER_FORMS for i in range(FORMS)]
    others += [(kinds[i % len(kinds)], i // len(kinds)) for i in range(DISCREPANT)]
    names = {f"sum-{i:03d}": ("sum", i) for i in range(SUMS_OF_THREE)}
    return names | {f"{kind}-{i}": (kind, i) for kind, i in others}


def simulated(name: str) -> Signal:
    """Return the simulated record of a name."""
    kind, number = simulated_names()[name]
    if kind == "sum":
        return sum_of_terms(number)
    if kind in OTHER_FORMS:
        return case(kind, SEED + number).signal
    return records.case(kind, SEED, number).signal


def answered(signal: Signal, sample: bool = False, measured: bool = False) -> dict[str, Any]:
    """Return the stored numbers of the answer on a record."""
    result = answer(signal, compare_models(signal), sample=sample, measured=measured)
    verdict = result.verdict
    logs = {
        f"{c.damping}@{c.restoring}": c.exact if c.log_evidence is None else c.log_evidence
        for c in (*result.content.candidates, *result.content.rivals)
        if np.isfinite(c.exact)
    }
    top = max(logs.values(), default=0.0)
    frequency = verdict.frequency
    return {
        "grade": str(verdict.grade),
        "damping": verdict.damping,
        "ratios": [_digits(d.amplitude, d.value, d.low, d.high) for d in verdict.damping_ratio],
        "frequency": None if frequency is None else _digits(frequency.value, frequency.low, frequency.high),
        "evidence": {
            n: round(log - top, 4) for n, log in sorted(logs.items(), key=lambda i: -i[1]) if log > top - 2 * NEAR
        },
    }  # fmt: skip


def _digits(*values: float) -> list[float]:
    return [float(f"{value:.8g}") for value in values]


def simulated_row(name: str) -> dict[str, Any]:
    """Return the stored answers on a simulated record."""
    signal = simulated(name)
    row = {"quick": answered(signal)}
    if list(simulated_names()).index(name) % SAMPLED == 0:
        row["sampled"] = answered(signal, sample=True)
    return row


def envelope_row(name: str) -> dict[str, Any]:
    """Return the stored answer on a ring-down."""
    rng = np.random.default_rng([SEED, int(name.split("-")[1])])
    ringdown = simulate(draw_ringdown(rng), rng)
    verdict = analyse(make_record(name, ringdown.t, ringdown.level, "dBm", 1e6)).verdict
    row: dict[str, Any] = {"grade": str(verdict.grade), "damping": verdict.damping}
    if verdict.rate is not None:
        intervals = [verdict.rate, *verdict.decay_rate]
        row["ratios"] = [_digits(0.0, i.value, i.low, i.high) for i in intervals]
    return {"quick": row}


def stored(group: str) -> dict[str, Any]:
    """Return the stored answers of a group, by record; none if there is no file."""
    path = FOLDER / f"{group}.json"
    return json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}


def write(group: str, rows: Mapping[str, Any]) -> None:
    """Write a group, a line for each record."""
    lines = ",\n".join(f"{json.dumps(n)}: {json.dumps(row)}" for n, row in sorted(rows.items()))
    (FOLDER / f"{group}.json").write_text("{\n" + lines + "\n}\n", encoding="utf-8")


def rows_of(group: str, names: Sequence[str]) -> Iterator[tuple[str, dict[str, Any]]]:
    """Answer the records of a group again, those of these names or all."""
    if group == "measured":
        if not DATA.exists():
            print(f"no folder {DATA}: the group `measured` is left out")
            return
        for record, decays in signals():
            numbered = {f"{record}-{i}": signal for i, signal in enumerate(decays, start=1)}
            for name in (n for n in numbered if not names or n in names):
                yield name, {"quick": answered(numbered[name], measured=True)}
        return
    every, row_of = list(simulated_names()), simulated_row
    if group == "envelopes":
        every, row_of = [f"ringdown-{i:02d}" for i in range(ENVELOPES)], envelope_row
    chosen = [n for n in every if not names or n in names]
    with ProcessPoolExecutor(WORKERS, mp_context=get_context("spawn")) as pool:
        yield from zip(chosen, pool.map(row_of, chosen), strict=True)


def differences(before: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """Return the differences between two answers on a record, in words."""
    words = [
        f"{key} {before[key]!r} -> {now[key]!r}" for key in ("grade", "damping") if before[key] != now[key]
    ]
    for old, new in zip(before.get("ratios", ()), now.get("ratios", ()), strict=False):
        words += _moved_ends(f"ratio at {old[0]:.3g}", old[1:], new[1:])
    old, new = before.get("frequency"), now.get("frequency")
    if old and new:
        words += _moved_ends("frequency", old, new)
    elif old != new:
        words.append(f"frequency {old} -> {new}")
    evidence = now.get("evidence", {})
    for name, log in before.get("evidence", {}).items():
        if log > -NEAR and name not in evidence:
            words.append(f"{name} is no longer compared")
        elif log > -NEAR and abs(evidence[name] - log) > NATS:
            words.append(f"evidence of {name} {log:.2f} -> {evidence[name]:.2f}")
    return words


def _moved_ends(what: str, old: Sequence[float], new: Sequence[float]) -> list[str]:
    width = max(old[2] - old[1], 1e-12 * abs(old[0]))
    moved = max(abs(new[i] - old[i]) for i in (1, 2)) / width
    return [f"{what} moved by {100 * moved:.0f} % of its width"] if moved > MOVED else []


def main(task: str, names: Sequence[str]) -> int:
    """Store the answers again, or compare them with the stored ones. Returns the exit status."""
    groups = ("simulated", "envelopes", "measured")
    chosen = [g for g in groups if g in names or not set(names) & set(groups)]
    moved = 0
    for group in chosen:
        rows, count = stored(group), 0
        for name, row in rows_of(group, [n for n in names if n not in groups]):
            if task == "freeze":
                write(group, rows := {**rows, name: row})
                continue
            for kind in set(row) & set(rows.get(name, {})):
                words = differences(rows[name][kind], row[kind])
                count, moved = count + 1, moved + bool(words)
                if words:
                    print(f"{name} {kind}: {'; '.join(words)}", flush=True)
        print(f"{group}: {count} answers compared, {moved} different so far")
        if names and not count and task == "compare":
            print(f"no stored answer in {group} is named {' or '.join(names)}")
            moved += 1
    return 1 if moved else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], sys.argv[2:]))
