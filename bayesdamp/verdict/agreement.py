"""Compare the first verdict on a record with a second one, or with damping ratios of another computation.

The first verdict is from linear approximations of each model, the second one from sampling the most probable models.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import log

from bayesdamp.types import NORMAL_95
from bayesdamp.verdict.thresholds import AGREEMENT_SDS, WIDTHS_AGREE
from bayesdamp.verdict.types import Verdict


@dataclass(frozen=True)
class Agreement:
    """Agreement of a second verdict with the first.

    same: whether both verdicts name the same damping terms without reservation, or neither verdict names a damping
    without reservation. moved: largest change of a damping ratio at one amplitude, in total standard deviations of the
    first verdict; 0 if either verdict has no damping ratios.
    """

    same: bool
    moved: float

    @property
    def confirms(self) -> bool:
        """Return whether the damping is the same and every ratio moved by less than `AGREEMENT_SDS` (half an sd)."""
        return self.same and self.moved < AGREEMENT_SDS


@dataclass(frozen=True)
class RatioAgreement:
    """How well another computation of a damping ratio agrees with the verdict, at one amplitude.

    amplitude: in the unit of the verdict. moved: change of the value, in total standard deviations of the verdict.
    wider: width of the other 95 % interval divided by that of the verdict.
    """

    amplitude: float
    moved: float
    wider: float

    @property
    def confirms(self) -> bool:
        """Return whether the value moved by less than `AGREEMENT_SDS` and the widths agree within `WIDTHS_AGREE`."""
        return self.moved < AGREEMENT_SDS and 1 / WIDTHS_AGREE < self.wider < WIDTHS_AGREE


def _compare(first: Verdict, ratios: Sequence[tuple[float, float, float]]) -> list[RatioAgreement]:
    """Return the agreement of each damping ratio of a verdict with another, given as (value, low, high).

    Both are in the order of the verdict's amplitudes; if there are fewer others, the remaining ratios are left out.
    """
    comparisons = []
    for r, (value, low, high) in zip(first.damping_ratio, ratios, strict=False):
        width = max(r.high - r.low, 1e-300)
        moved = abs(value - r.value) * 2 * NORMAL_95 / width
        comparisons.append(RatioAgreement(r.amplitude, moved, (high - low) / width))
    return comparisons


def worst_agreement(first: Verdict, ratios: Sequence[tuple[float, float, float]]) -> RatioAgreement:
    """Compare the damping ratios at all amplitudes, and return the comparison that agrees worst.

    It has the largest of moved/`AGREEMENT_SDS` and |ln wider|/ln `WIDTHS_AGREE` (see `RatioAgreement`).

    Parameters
    ----------
    first
        The verdict that is checked.
    ratios
        The other damping ratios: the value and both ends of its 95 % interval (dimensionless), in the order of the
        verdict's amplitudes. At least one; if there are fewer than amplitudes, the other amplitudes are not compared.
    """
    return max(
        _compare(first, ratios),
        key=lambda i: max(i.moved / AGREEMENT_SDS, abs(log(max(i.wider, 1e-300))) / log(WIDTHS_AGREE)),
    )


def agreement(first: Verdict, second: Verdict) -> Agreement:
    """Compare a second verdict on a record with the first; dampings are the same if they have the same terms.

    The damping ratios of both verdicts must be at the same amplitudes, in the same order.
    """
    dampings = {frozenset(v.damping.split("+")) if v.decided else frozenset() for v in (first, second)}
    comparisons = _compare(first, [(r.value, r.low, r.high) for r in second.damping_ratio])
    return Agreement(len(dampings) == 1, max((i.moved for i in comparisons), default=0.0))
