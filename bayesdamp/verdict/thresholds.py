"""Every threshold of a verdict. Chosen on simulated records with the seeds 1 to 9; reported on others."""

from math import log

DECIDED = 0.95
"""Probability from which one damping is named without reservation (conventional)."""
CAP = 0.99
"""Largest probability that is claimed of a measured record: statements above 0.95 were right in nine of ten records
whose law does not hold exactly."""
NAMED = 0.05
"""Probability from which a rival is named."""
EXACT = 0.03
"""Upper end of the deviation of the damping law up to which a record is said to follow the law."""
DEVIATES = 0.25
"""Deviation of the damping law from which it is not the answer."""
RESTORING_DEVIATES = 0.05
"""Lower end of the deviation of the restoring law from which it is not the answer."""
CONTRADICTS, WIDER = 0.05, 2.0
"""Relative difference between a law's damping ratio and the one measured without a law from which, where their
intervals do not meet either, the law is not the answer; and by how much the measured interval is widened for that. Less
may be the law-free curve's own approximation (measured: of 55 simulated records with and without discrepancies, none is
then contradicted)."""
SAME_AMPLITUDE = 0.05
"""Difference of log amplitudes up to which two damping ratios are compared."""
CONTRADICTS_FREQUENCY = 0.002
"""The same of the frequency."""
LIKELY_EXACT = 0.5
"""Probability that the law of an envelope's decay holds exactly from which the record is said to follow it."""
POWER_LAW = log(20.0)
"""Log Bayes factor from which one power of the amplitude describes an envelope better than every sum."""
UNEXPLAINED = 0.05
"""Share of the amplitude, left unexplained, from which the law is not the answer."""
UNDESCRIBED = 0.5
"""The same from which the law does not even describe the record (conventional): less than half of it is the law's."""
OTHER_MOTION = 0.05
"""Share of the amplitude of the first oscillation from which a second one, or growth, is what a record is about."""
REMARK = 0.01
"""Share of the amplitude from which what is left unexplained is remarked on."""
EXTRAPOLATED = 0.005
"""Share of the natural frequency from which it is told as an extrapolation, after that at an amplitude of the record:
of their difference, or of half its interval (conventional)."""
UNDETERMINED = 0.05
"""Width of its interval, as a share of itself, from which the natural frequency is left out: the record does not
determine it (conventional)."""
MIDLINE = 0.002
"""Share of the first amplitude from which a midline's drift is remarked on (a sensor's usual linearity)."""
TWIN = 0.3
"""Share of the energy from which a term's twin, which loses alike at every amplitude, must be excluded for a sum
without it to be named without reservation (conventional: the share from which a term is one of a record's)."""
TERM_SURE = 0.95
"""Probability, summed over the sums that have it, from which a term is said to be sure by itself."""
EXPONENT_NAMED = 0.3
"""Half width of an exponent's interval up to which the law that it holds is named."""
HARDLY_FALLS = 0.7
"""Share of the first amplitude that is left at the end from which dampings are said to be told apart poorly."""
FEW_READINGS = 20
"""Readings of an envelope below which its noise is said to be hardly known, and no power law is told from a sum."""
SHALLOW = 10.0
"""dB of fall of an envelope below which dampings are said to be hardly told apart."""
MOVED = 0.5
"""Standard deviations of a damping ratio, or of a coefficient, below which it has not moved."""
WIDTHS_AGREE = 1.25
"""Factor by which an interval may be wider or narrower: ends by a few hundred draws move by a tenth of the width."""
WIDTH_HOLDS = 0.8
"""Probability that the leading damping should keep whatever the width of the given priors (conventional)."""
AVERAGED = 0.1
"""Posterior standard deviations by which averaging may move a parameter without a reservation."""
