"""Define every threshold of a verdict.

They were chosen on simulated records with seeds 1 to 9; the reported accuracy is on other seeds.
"""

from math import log

DECIDED = 0.95
"""Probability from which one damping is named without reservation (conventional)."""
CAP = 0.99
"""Largest probability that is given for a measured record (measured: if laws do not hold exactly, nine in ten
statements with a probability above 0.95 were right)."""
NAMED = 0.05
"""Probability from which another damping is mentioned in the sentence."""
EXACT = 0.03
"""Upper end of the interval of the damping law's deviation up to which the grade is exact."""
DEVIATES = 0.25
"""Deviation of the damping law from which the grade is `DEVIATES`: no law is named as the answer."""
RESTORING_DEVIATES = 0.05
"""Lower end of the interval of the restoring law's deviation from which the grade is `DEVIATES`."""
CONTRADICTS, WIDER = 0.05, 2.0
"""Relative difference between damping ratios with and without a law from which the law is contradicted, if the
intervals do not overlap either; and the factor by which the law-free interval is widened for this. Smaller differences
may be due to the approximations of the law-free curve (measured: none of 55 simulated records is contradicted)."""
SAME_AMPLITUDE = 0.05
"""Difference of log amplitudes up to which two amplitudes count as the same."""
CONTRADICTS_FREQUENCY = 0.002
"""As `CONTRADICTS`, for the frequency."""
LIKELY_EXACT = 0.5
"""Probability of an exact law from which the grade of an envelope is exact."""
POWER_LAW = log(20.0)
"""Log Bayes factor of a single power of the amplitude against all sums from which an envelope's rates are from it."""
UNEXPLAINED = 0.05
"""Unexplained fraction of the amplitude from which the grade is `DEVIATES`."""
UNDESCRIBED = 0.5
"""Unexplained fraction of the amplitude from which no damping model describes the record (conventional: half)."""
OTHER_MOTION = 0.05
"""Size of a second oscillation or of a growth, relative to the amplitude of the first oscillation, from which the
record is not a free decay of one oscillator."""
REMARK = 0.01
"""Unexplained fraction of the amplitude from which there is a remark on it."""
EXTRAPOLATED = 0.005
"""Relative difference between the natural frequency and the frequency at an amplitude of the record, or relative half
interval of the natural frequency, from which the natural frequency is given only as an extrapolation (conventional)."""
UNDETERMINED = 0.05
"""Relative width of the natural frequency's interval from which it is omitted, as not determined (conventional)."""
MIDLINE = 0.002
"""Drift of the midline, as a fraction of the first amplitude, from which there is a remark (usual linearity of
sensors)."""
TWIN = 0.3
"""Upper limit of the energy fraction of a term's twin (a term with the same loss at every amplitude) from which a sum
without the twin is not named without reservation (conventional)."""
TERM_SURE = 0.95
"""Probability of a term, over all sums with it, from which the sentence says that the term is sure."""
EXPONENT_NAMED = 0.3
"""Half width of an exponent's interval up to which the sentence names the law with this exponent."""
HARDLY_FALLS = 0.7
"""Ratio of last to first amplitude from which a remark says that damping models are hard to distinguish."""
FEW_READINGS = 20
"""Number of readings of an envelope below which its noise is hardly known, and no power law replaces the sums."""
SHALLOW = 10.0
"""Fall of an envelope in dB below which a remark says that damping models are hard to distinguish."""
MOVED = 0.5
"""Change of a damping ratio or coefficient, in its standard deviations, up to which two computations agree."""
WIDTHS_AGREE = 1.25
"""Factor by which intervals of two computations may differ: with a few hundred draws, ends vary by a tenth of the
width.
"""
WIDTH_HOLDS = 0.8
"""Probability that the named damping should keep if the widths of given priors are varied (conventional)."""
AVERAGED = 0.1
"""Shift of a parameter by averaging, in its posterior standard deviations, up to which there is no reservation."""
