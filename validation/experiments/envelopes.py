"""Answer simulated ring-downs, and count how often the intervals of their damping contain the truth.

    python -m validation.experiments.envelopes RECORDS SEED [KIND]

prints a line for each record, and the counts. KIND `plain`: one damping law and a constant noise floor. KIND `harsh`
(the default): deviations from the law, a drifting gain, a noise floor that varies and is partly slow, and a drive whose
direct pickup by the sensor vanishes at the release.
"""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np

from bayesdamp.interface.envelopes import analyse
from bayesdamp.records.envelope.record import make_record
from bayesdamp.verdict.envelope import EnvelopeAnswer
from bayesdamp.verdict.parts import AtAmplitude, MeasuredNumber
from validation.truth.ringdowns import NEPER, Ringdown, Simulated, decay_rate, simulate

CASES = ("viscous", "coulomb", "quadratic", "viscous+coulomb", "viscous+quadratic")


def draw_ringdown(kind: str, rng: np.random.Generator) -> Ringdown:
    """Draw the parameters of a ring-down of the kind "plain" or "harsh" (see the module).

    It lasts 20 to 60 s, falls by 20 to 50 dB to its noise floor, and has 100 to 4,000 readings.
    """
    duration, fall = float(rng.uniform(20, 60)), float(rng.uniform(20, 50))
    terms = CASES[rng.integers(len(CASES))].split("+")
    fall = min(fall, 30.0) if terms == ["quadratic"] else fall
    share = 1.0 if len(terms) == 1 else float(rng.uniform(0.3, 0.7))
    mean = fall / NEPER / duration
    # Shares of terms that grow or fall with the amplitude are those at half of the fall.
    middle = float(np.exp(-0.5 * fall / NEPER))
    size = {"viscous": 1.0, "coulomb": middle, "quadratic": 1 / middle}
    step = duration / float(np.exp(rng.uniform(np.log(100), np.log(4000))))
    plain = Ringdown(
        rates={t: mean * part * size[t] for t, part in zip(terms, (share, 1 - share))},
        fall=fall,
        step=step,
        before=0.3 * duration,
        behind=0.5 * duration,
        scatter=float(np.exp(rng.uniform(np.log(0.01), np.log(0.1)))),
        scatter_time=float(rng.uniform(2 * step, 0.02 * duration + 2 * step)),
        floor_time=float(rng.uniform(step, 0.01 * duration + step)),
        slow_share=0.0,
    )
    if kind == "plain":
        return plain
    return replace(
        plain,
        deviation=float(rng.choice([0.0, 0.01, 0.03, 0.06])),
        deviation_length=float(rng.choice([0.1, 0.3, 1.0])),
        drift=float(rng.choice([0.0, 0.1])),
        slow_share=float(rng.uniform(0, 1)),
        wander=float(rng.choice([0.0, 1.0])),
        constant=float(rng.choice([0.0, 0.5])),
        drop=float(rng.choice([0.0, 4.0, 10.0])),
        hold=float(rng.uniform(0.1, 1.0)),
    )


def errors(ringdown: Ringdown, truth: Simulated, answer: EnvelopeAnswer) -> tuple[np.ndarray, np.ndarray]:
    """Compare the decay rates of an answer with the truth.

    Returns
    -------
    z, inside : (4,) array
        Errors in standard deviations, and whether the 95 % intervals contain the truth. The first element is for the
        mean decay rate over the first half of the fall in dB, from which Q follows; its truth is that of the law
        without deviations. The others are for the decay rates at three amplitudes; their truth is the mean over a tenth
        of the fall, with deviations.
    """
    assert answer.curve is not None
    assert answer.verdict.rate is not None
    falling = np.isfinite(truth.x)
    x, t = truth.x[falling], truth.t[falling]
    first, last = ((answer.curve.fit[i] - ringdown.top) / NEPER for i in (0, -1))
    grid = np.linspace(first, 0.5 * (first + last), 400)
    mean = (grid[0] - grid[-1]) / np.trapezoid(1 / decay_rate(grid, ringdown.rates), -grid)
    pairs: list[tuple[MeasuredNumber | AtAmplitude, float]] = [(answer.verdict.rate, float(mean))]
    for at in answer.verdict.decay_rate:
        middle = (at.amplitude - ringdown.top) / NEPER
        span = 0.05 * (first - last)
        near = np.clip([middle + span, middle - span], x[-1], x[0])
        # No interval contains the rate at an amplitude above the release's, which never decayed freely.
        fell = near[0] > near[1]
        pairs.append((at, (near[0] - near[1]) / np.diff(np.interp(-near, -x, t))[0] if fell else np.nan))
    z = [(e.value - true) / np.hypot(e.sd_noise, e.sd_law) for e, true in pairs]
    return np.array(z), np.array([e.low <= true <= e.high for e, true in pairs])


def main(records: int, seed: int, kind: str = "harsh") -> None:
    """Run the experiment: answer several ring-downs, and print the counts."""
    rows = []
    for i in range(records):
        rng = np.random.default_rng([seed, i])
        ringdown = draw_ringdown(kind, rng)
        truth = simulate(ringdown, rng)
        answer = analyse(make_record(str(i), truth.t, truth.level, "dBm", 1e6))
        if answer.verdict.rate is None or answer.verdict.window is None:
            print(i, answer.verdict.sentence, flush=True)
            continue
        z, inside = errors(ringdown, truth, answer)
        rows.append((z, inside))
        cut = answer.verdict.window.start - truth.release
        print(
            i, ringdown, f"n {truth.t.size} ->", answer.verdict.damping, answer.verdict.grade, np.round(z, 2), *inside,
            f"cut {cut:.2f}", flush=True,
        )  # fmt: skip
    z, inside = (np.array(each) for each in zip(*rows, strict=True))
    print(
        f"{kind} seed {seed}: {len(rows)} answered, {records - len(rows)} refused; share {inside.mean():.3f}"
    )
    print("intervals with the true rate, and with those at amplitudes", inside.sum(axis=0))
    print("median z²", np.round(np.nanmedian(z**2, axis=0), 2))


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]), *sys.argv[3:])
