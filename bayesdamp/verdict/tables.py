"""Build the tables of a verdict: damping ratios against amplitude, and oscillations of what is not a free decay."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

from bayesdamp import formatting as fmt
from bayesdamp.table import Table
from bayesdamp.verdict.parts import AtAmplitude, DampingRatio, Interval, Measured, MotionKind, Oscillation


def quality_of(r: DampingRatio) -> str:
    """Return Q at an amplitude with its interval, which has no upper end where zero damping is possible."""
    if not r.value > 0:
        return fmt.NONE
    if not r.low > 0:
        return f"{0.5 / r.value:.3g} (above {0.5 / r.high:.3g})"
    return fmt.with_interval(0.5 / r.value, 0.5 / r.high, 0.5 / r.low)


def ratios_table(ratios: Iterable[DampingRatio], caption: str = "", parts: bool = False) -> Table:
    """Return the damping ratios against amplitude; `parts` adds the parts of their standard deviations."""
    columns: dict[str, Callable[[DampingRatio], str]] = {
        "amplitude": lambda r: f"{r.amplitude:.3g} {r.unit}",
        "equivalent damping ratio (95 %)": lambda r: fmt.with_interval(r.value, r.low, r.high, " %", 100),
        "Q": quality_of,
    }
    if parts:
        columns["sd from noise"] = lambda r: f"{100 * r.sd_noise:.2g} %"
        columns["sd from the law"] = lambda r: f"{100 * r.sd_law:.2g} %"
    return Table.of(ratios, columns, caption=caption)


def decay_table(rates: Sequence[AtAmplitude], qualities: Sequence[AtAmplitude]) -> Table:
    """Return the decay rate of an envelope, and Q where there is one, at amplitudes of the record."""
    columns: dict[str, Callable[[int], str]] = {
        "amplitude": lambda i: f"{fmt.by_ten(f'{rates[i].amplitude:.4g}')} {rates[i].unit}",
        "rate / (1/s) (95 %)": lambda i: number(rates[i]),
    }
    if qualities:
        columns["Q (95 %)"] = lambda i: number(qualities[i])
    return Table.of(range(len(rates)), columns)


def number(value: Measured | Interval | AtAmplitude | None) -> str:
    """Return a number with its 95 % interval, in powers of ten where it is large."""
    return fmt.NONE if value is None else fmt.by_ten(fmt.with_interval(value.value, value.low, value.high))


def modes_table(modes: Iterable[Oscillation], motion: MotionKind | None) -> Table:
    """Return the oscillations of a record that is not the free decay of one oscillator."""
    first, last = ("least", "largest") if motion is MotionKind.EXCITED else ("first", "last")
    columns: dict[str, Callable[[Oscillation], str]] = {
        "frequency": lambda m: f"{m.frequency:.5g} Hz",
        "damping ratio (95 %)": lambda m: fmt.with_interval(m.damping_ratio, m.low, m.high, " %", 100),
        f"{first} amplitude": lambda m: f"{m.first:.3g} {m.unit}",
        f"{last} amplitude": lambda m: f"{m.last:.3g} {m.unit}",
    }
    return Table.of(modes, columns, left=(), caption="The oscillations that are in it")
