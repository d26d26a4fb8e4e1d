"""Test on simulated records whether intervals contain the truth, and models are true, as often as stated."""

from bayesdamp.calibrate.run import run_calibration

__all__ = ["run_calibration"]
