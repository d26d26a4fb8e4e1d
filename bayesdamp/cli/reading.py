"""How files are read, as the command line says it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from bayesdamp.cli.options import bound, wrong
from bayesdamp.records.files.names import SECONDS, by_name
from bayesdamp.records.read import FASTEST, SLOWEST
from bayesdamp.types import InputError
from bayesdamp.units import UNITS

QUANTITIES = ("angle", "velocity", "acceleration")
CLOCKS = ("auto", "as_logged", "uniform")
TIME_UNITS = ("s", "ms", "us", "ns", "ps", "min", "h", "d")


@dataclass(frozen=True)
class Options:
    """How to read files, as the command line says it; see `compare`."""

    time: str | None = None
    angle: str | None = None
    rate: float | None = None
    time_unit: str | None = None
    unit: str | None = None
    quantity: str | None = None
    clock: str = "auto"
    start: float | str = "auto"
    stop: float | str = "auto"
    runs: str | None = None
    channels: Sequence[str] = ()

    def __post_init__(self) -> None:
        """Raises InputError for what no file could be read by."""
        for field, value in zip(("unit", "quantity"), by_name(self.unit, self.quantity), strict=True):
            object.__setattr__(self, field, value)
        known = {"unit": UNITS, "quantity": QUANTITIES, "clock": CLOCKS, "time_unit": TIME_UNITS}
        for name, valid in known.items():
            given = getattr(self, name)
            if (
                given is not None
                and given not in valid
                and not (name == "time_unit" and given.lower() in SECONDS)
            ):
                also = "; compare and look take envelope too" if name == "quantity" else ""
                raise wrong(f"--{name.replace('_', '-')}", given, f"one of {', '.join(valid)}{also}")
        for name in ("start", "stop"):
            object.__setattr__(self, name, bound(getattr(self, name), f"--{name}"))
        if isinstance(self.start, float) and isinstance(self.stop, float) and self.start >= self.stop:
            raise wrong("--stop", self.stop, f"later than --start ({self.start:g})")
        if self.rate is not None and not SLOWEST <= self.rate <= FASTEST:
            raise wrong(
                "--rate", self.rate, f"a number of samples per second from {SLOWEST:g} to {FASTEST:g}"
            )
        if self.rate is not None and self.time is not None:
            raise InputError("--rate: stands in for a column of times; leave out it or --time")
