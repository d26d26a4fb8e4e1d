"""Define every threshold of a verdict. Chosen on simulated records with the seeds 1 to 9; reported on others."""

from math import log

DECIDED = 0.95
"""Probability from which one damping is named without reservation (conventional)."""
CAP = 0.99
"""Largest probability that is claimed for a measured record (measured: of records whose law does not hold exactly, nine
in ten statements above 0.95 were right)."""
NAMED = 0.05
"""Probability from which a rival is named."""
EXACT = 0.03
"""Upper end of the deviation of the damping law up to which the record follows the law."""
DEVIATES = 0.25
"""Deviation of the damping law from which the law is not the answer."""
RESTORING_DEVIATES = 0.05
"""Lower end of the deviation of the restoring law from which the law is not the answer."""
CONTRADICTS, WIDER = 0.05, 2.0
"""Relative difference between a law's damping ratio and the law-free one from which the law is not the answer, if their
intervals do not meet either; and the factor that widens the law-free interval for that. A smaller difference may be the
approximation of the law-free curve (measured: it contradicts none of 55 simulated records with and without
discrepancies)."""
SAME_AMPLITUDE = 0.05
"""Difference of log amplitudes up to which two damping ratios are compared."""
CONTRADICTS_FREQUENCY = 0.002
"""The same as `CONTRADICTS`, for the frequency."""
LIKELY_EXACT = 0.5
"""Probability that the law of an envelope's decay holds exactly, from which the grade is exact."""
POWER_LAW = log(20.0)
"""Log Bayes factor from which one power of the amplitude describes an envelope better than every sum."""
UNEXPLAINED = 0.05
"""Unexplained share of the amplitude from which the law is not the answer."""
UNDESCRIBED = 0.5
"""Unexplained share of the amplitude from which the law does not describe the record at all (conventional: half)."""
OTHER_MOTION = 0.05
"""Size of a second oscillation, or of a growth, relative to the amplitude of the first oscillation, from which the
record is not a free decay."""
REMARK = 0.01
"""Unexplained share of the amplitude from which there is a remark on it."""
EXTRAPOLATED = 0.005
"""Share of the natural frequency from which it is given as an extrapolation, after the frequency at an amplitude of the
record: of their difference, or of half its interval (conventional)."""
UNDETERMINED = 0.05
"""Relative width of its interval from which the natural frequency is left out: the record does not determine it
(conventional)."""
MIDLINE = 0.002
"""Share of the first amplitude from which there is a remark on the midline's drift (a sensor's usual linearity)."""
TWIN = 0.3
"""Share of the energy below which a term's twin, which loses the same at every amplitude, must lie for a sum without it
to be named without reservation (conventional: the share from which a term belongs to a record's damping)."""
TERM_SURE = 0.95
"""Probability, summed over the sums that have it, from which a term is sure by itself."""
EXPONENT_NAMED = 0.3
"""Half width of an exponent's interval up to which the law in the interval is named."""
HARDLY_FALLS = 0.7
"""Share of the first amplitude left at the end from which dampings are hard to distinguish."""
FEW_READINGS = 20
"""Readings of an envelope below which its noise is hardly known, and a power law is not distinguished from a sum."""
SHALLOW = 10.0
"""Fall of an envelope in dB below which dampings are hard to distinguish."""
MOVED = 0.5
"""Standard deviations of a damping ratio, or of a coefficient, below which it has not moved."""
WIDTHS_AGREE = 1.25
"""Factor by which an interval may be wider or narrower: ends from a few hundred draws move by a tenth of the width."""
WIDTH_HOLDS = 0.8
"""Probability that the leading damping should keep for every width of the stated priors (conventional)."""
AVERAGED = 0.1
"""Posterior standard deviations by which averaging may move a parameter without a reservation."""
