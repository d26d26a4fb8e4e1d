"""Fit simulated pairs of records jointly under approximate laws, and count how often intervals contain the truth.

    python -m validation.experiments.repeated PAIRS SEED [APART]

prints a line for each pair and counts. A pair has one viscous damping, which rises in one record and falls in the other
by up to 10 %. With APART the damping of the second record is larger by that share instead (0.16: two specimens), and
both drift at random. SciPy's eighth-order solver computes the motions; the start, the spring and the noise are inferred
with everything else.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from scipy.integrate import solve_ivp

from bayesdamp.config import load_study
from bayesdamp.pipeline.jobs import Depth
from bayesdamp.pipeline.run import run_study
from bayesdamp.pipeline.specimens import Specimen, compute_joint
from bayesdamp.pipeline.tasks import perform
from bayesdamp.store import Store
from bayesdamp.store.contents import CLEAR, JointContent

STUDY = """
version = 1
name = "pair"
seed = 5
[system]
restoring = "linear"
[estimators]
use = ["least_squares"]
stages = ["initial"]
[models]
compare = ["viscous"]
[posterior]
samplers = []
deviation = "law"
[evidence]
methods = ["laplace"]
"""
SIGNAL = """
[[signal]]
name = "{name}"
specimen = "pair"
file = "{name}.csv"
start = 0.0
stop = {stop}
"""
SHAPES = (lambda s: 1 - 2 * s, lambda s: np.sin(2 * np.pi * s), lambda s: np.cos(2 * np.pi * s))
"""Shapes of the log deviation along the record, s from 0 to 1; their means are 0, so that ζ is the mean damping."""


@dataclass(frozen=True)
class Pair:
    """A pair of records.

    Attributes
    ----------
    zeta : tuple
        Damping coefficient of each record in 1/s.
    drift : tuple
        Size of the log deviation of each.
    records : tuple of (n, 2) arrays
        Times in s and angles in rad.
    """

    zeta: tuple[float, float]
    drift: tuple[float, float]
    records: tuple[np.ndarray, np.ndarray]


def simulate(rng: np.random.Generator, apart: float | None) -> Pair:
    """Simulate records of 8 to 20 cycles with 25 samples each.

    The amplitude falls to between a tenth and a half; the noise is 0.2 to 1 %.
    """
    cycles, left = int(rng.integers(8, 21)), float(np.exp(rng.uniform(np.log(0.1), np.log(0.5))))
    omega, noise = float(rng.uniform(3, 6)), float(np.exp(rng.uniform(np.log(0.002), np.log(0.01))))
    shape, size = SHAPES[rng.integers(len(SHAPES))], float(rng.uniform(0.02, 0.1))
    stop = cycles * 2 * np.pi / omega
    zeta = -np.log(left) / stop
    times = np.linspace(0, stop, 25 * cycles)
    signs = (1.0, -1.0) if apart is None else rng.choice([-1.0, 1.0], 2)
    zetas = (zeta, zeta * (1 + (apart or 0.0)))
    drifts = (float(signs[0]) * size, float(signs[1]) * size)
    records = []
    for z, d in zip(zetas, drifts, strict=True):
        start = float(rng.uniform(0.2, 0.4))

        def slope(t: float, s: np.ndarray, z: float = z, d: float = d) -> tuple[float, float]:
            return s[1], -2 * z * np.exp(d * shape(t / stop)) * s[1] - omega**2 * s[0]

        y = solve_ivp(slope, (0, stop), (start, 0.0), "DOP853", times, rtol=1e-10, atol=1e-12).y[0]
        records.append(np.column_stack([times, y + noise * start * rng.standard_normal(times.size)]))
    return Pair(zetas, drifts, (records[0], records[1]))


def joined(pair: Pair) -> JointContent | str:
    """Return the joint fit, or the reason why it failed.

    It starts from the first answers on the records. They are not sampled, because that does not change the fit.
    """
    with TemporaryDirectory() as temporary:
        folder, text = Path(temporary), STUDY
        for j, record in enumerate(pair.records):
            np.savetxt(
                folder / f"r{j}.csv", record, delimiter=",", header="time (s),angle (rad)", comments=""
            )
            text += SIGNAL.format(name=f"r{j}", stop=float(record[-1, 0]))
        (folder / "pair.toml").write_text(text, encoding="utf-8")
        study, store = load_study(folder / "pair.toml"), Store(folder / "out")
        run_study(study, folder / "out", workers=1, depth=Depth.ANSWER, quiet=True)
        specimen = Specimen(study, "pair", study.specimens["pair"], store)
        perform(store, "joint/pair", specimen.key, partial(compute_joint, specimen))
        result = store.read("joint/pair")
    return JointContent.maybe(result) or result.outcome


def main(pairs: int, seed: int, apart: float | None = None) -> None:
    """Fit several pairs, and print the counts."""
    inside, factors, errors, differ, spread = [], [], [], [], []
    for i in range(pairs):
        pair = simulate(np.random.default_rng([seed, i]), apart)
        joint = joined(pair)
        if isinstance(joint, str):
            print(i, joint, flush=True)
            continue
        zeta = joint.candidates["viscous"].summary["zeta"]
        truth = float(np.sqrt(pair.zeta[0] * pair.zeta[1]))
        inside.append(zeta["q2.5"] <= truth <= zeta["q97.5"])
        factors.append(joint.no_spread)
        differ.append(joint.differ)
        true_spread = abs(float(np.log(pair.zeta[1] / pair.zeta[0]))) / 2
        spread.append(joint.spread["q2.5"] <= true_spread <= joint.spread["q97.5"])
        errors.append((zeta["mean"] - truth) / zeta["sd"])
        own = [(a.summary["zeta"]["mean"] / z - 1) * 100 for a, z in zip(joint.alone.values(), pair.zeta)]
        print(
            i, f"drift {pair.drift[0]:+.3f} {pair.drift[1]:+.3f} n {len(pair.records[0])} zeta {truth:.4f} ->",
            f"{zeta['mean']:.4f} sd {zeta['sd'] / truth:.2%} z {errors[-1]:+.2f}", inside[-1],
            f"no spread {factors[-1]:+.1f} spread {joint.spread['median']:.2%} ({joint.spread['q2.5']:.2%} to",
            f"{joint.spread['q97.5']:.2%}) alone off by {own[0]:+.2f} {own[1]:+.2f} %", flush=True,
        )  # fmt: skip
    factor = np.array(factors)
    print(
        f"seed {seed}, apart {apart}: {factor.size} of {pairs} joined; intervals that hold the mean of the two",
        f"{np.sum(inside)}, mean z2 {np.mean(np.square(errors)):.2f}; one size is likelier {np.sum(factor > 0)},",
        f"by 3 nats {np.sum(factor >= CLEAR)}; two by 3 nats {np.sum(factor < -CLEAR)}; said to differ",
        f"{np.sum(differ)}", *([f"intervals that hold the spread {np.sum(spread)}"] if apart else []), flush=True,
    )  # fmt: skip


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]), *map(float, sys.argv[3:]))
