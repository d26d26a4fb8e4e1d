"""Answer simulated ring-downs, and count how often the intervals of their damping contain the truth.

    python -m validation.experiments.envelopes RECORDS SEED [KIND]

prints the counts. KIND: `plain` or `harsh` (the default), as in `validation.truth.ringdowns.draw_ringdown`.
"""

from __future__ import annotations

import sys

import numpy as np

from bayesdamp.interface.envelopes import analyse
from bayesdamp.records.envelope.record import make_record
from bayesdamp.verdict.envelope import EnvelopeAnswer
from validation.truth.ringdowns import NEPER, Ringdown, Simulated, decay_rate, draw_ringdown, simulate


def true_rates(ringdown: Ringdown, truth: Simulated, answer: EnvelopeAnswer) -> list[float]:
    """Return the true values, in 1/s, of the rates that an answer gives.

    ringdown, truth: parameters of the simulated ring-down, and its true course. answer: the answer on its readings.

    The first is the mean decay rate over the first half of the fall in dB, from which Q follows, by the law without
    deviations. The others are the decay rates at three amplitudes, means over a tenth of the fall, with deviations; NaN
    for an amplitude above that of the release, which never decayed freely.
    """
    assert answer.curve is not None
    falling = np.isfinite(truth.x)
    x, t = truth.x[falling], truth.t[falling]
    first, last = ((answer.curve.fit[i] - ringdown.top) / NEPER for i in (0, -1))
    grid = np.linspace(first, 0.5 * (first + last), 400)
    rates = [float((grid[0] - grid[-1]) / np.trapezoid(1 / decay_rate(grid, ringdown.rates), -grid))]
    for at in answer.verdict.decay_rate:
        middle, span = (at.amplitude - ringdown.top) / NEPER, 0.05 * (first - last)
        near = np.clip([middle + span, middle - span], x[-1], x[0])
        fell = near[0] > near[1]
        rates.append((near[0] - near[1]) / np.diff(np.interp(-near, -x, t))[0] if fell else np.nan)
    return rates


def main(records: int, seed: int, kind: str = "harsh") -> None:
    """Simulate and answer several ring-downs, and print how many of their 95 % intervals contain the truth.

    records: number of ring-downs. seed: seed of their random numbers. kind: "plain" or "harsh".
    """
    inside = []
    for i in range(records):
        rng = np.random.default_rng([seed, i])
        ringdown = draw_ringdown(kind, rng)
        truth = simulate(ringdown, rng)
        answer = analyse(make_record(str(i), truth.t, truth.level, "dBm", 1e6))
        if answer.verdict.rate is not None:
            stated = (answer.verdict.rate, *answer.verdict.decay_rate)
            true = true_rates(ringdown, truth, answer)
            inside.append([s.low <= rate <= s.high for s, rate in zip(stated, true, strict=True)])
    print(f"{kind} seed {seed}: {len(inside)} of {records} answered; share {np.mean(inside):.3f}")
    print("intervals with the true rate, and with those at three amplitudes:", np.sum(inside, axis=0))


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]), *sys.argv[3:])
