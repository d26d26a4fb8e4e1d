"""A verdict as a line of verdicts.csv."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bayesdamp.verdict.types import Verdict


def row_of(v: Verdict) -> dict[str, object]:
    """A verdict as a line: three amplitudes, the first three rivals and the terms' shares in columns of their own."""
    row: dict[str, object] = {
        "record": v.record,
        "grade": str(v.grade),
        "decided": v.decided,
        "damping": v.damping,
        "probability": v.probability,
        "rivals": " ".join(f"{r.damping}:{r.probability:.4g}" for r in v.rivals),
        "restoring": v.restoring,
        "restoring_probability": v.restoring_probability,
        "unexplained_pct": v.unexplained_pct,
        "noise_pct": v.noise_pct,
        "midline_drift_pct": v.midline_drift_pct,
        "energy": " ".join(f"{s.term}:{s.share:.4g}({s.low:.4g},{s.high:.4g})" for s in v.energy),
        "other_forms": " ".join(f"{b.form.replace(' ', '_')}:{b.share_below:.4g}" for b in v.other_forms),
        "remarks": " ".join(v.remarks),
        "sentence": v.sentence,
    }
    for name in ("frequency", "frequency_at", "exponent", "deviation", "unnamed"):
        one = getattr(v, name)
        if one is not None:
            row |= {name: one.value, f"{name}_low": one.low, f"{name}_high": one.high}
    for i, ratio in enumerate(v.damping_ratio[:3], start=1):
        row |= {f"amplitude_{i}": ratio.amplitude, f"unit_{i}": ratio.unit}
        row |= {f"ratio_{i}": ratio.value, f"ratio_{i}_low": ratio.low, f"ratio_{i}_high": ratio.high}
        row |= {f"ratio_{i}_sd_noise": ratio.sd_noise, f"ratio_{i}_sd_law": ratio.sd_law}
    if v.window is not None:
        row |= {"start": v.window.start, "stop": v.window.stop, "cycles": v.window.cycles}
    return row
