"""Calibration as a command: are the intervals and the models' probabilities what they claim to be?"""

from bayesdamp.calibrate.run import run_calibration

__all__ = ["run_calibration"]
