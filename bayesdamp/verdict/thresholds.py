"""Define every threshold of a verdict.

They were chosen on simulated records with seeds 1 to 9; the reported accuracy is on other seeds.
"""

from math import log

DECIDED = 0.95
"""One damping is named without reservation only if its probability is at least this (conventional)."""
CAP = 0.99
"""Largest probability that is given for a measured record (measured: if laws do not hold exactly, nine in ten
statements with a probability above 0.95 were right)."""
NAMED = 0.05
"""Another damping is mentioned in the sentence if its probability is at least this."""
EXACT = 0.03
"""The grade is exact if the 95 % interval of the deviation from the damping law (a fraction) ends at or below this."""
DEVIATES = 0.25
"""If the deviation from the damping law (a fraction; its median, for an envelope its 97.5 % quantile) is larger, the
grade is `DEVIATES`: no law is named as the answer."""
RESTORING_DEVIATES = 0.05
"""The grade is `DEVIATES` if the 95 % interval of the deviation from the restoring law (a fraction) begins above
this."""
CONTRADICTS, WIDER = 0.05, 2.0
"""A law is contradicted if its damping ratio differs by more than this fraction from the law-free one, and their
intervals do not overlap even if the law-free interval is widened by the second factor. Smaller differences
may be due to the approximations of the law-free curve (measured: none of 55 simulated records is contradicted)."""
SAME_AMPLITUDE = 0.05
"""Two amplitudes count as the same if their logarithms differ by less than this."""
CONTRADICTS_FREQUENCY = 0.002
"""A restoring law is contradicted if its frequency differs by more than this fraction from the law-free one, and their
intervals do not overlap even if the law-free interval is widened by `WIDER`."""
LIKELY_EXACT = 0.5
"""The grade of an envelope is exact if the probability of an exact law is at least this."""
POWER_LAW = log(20.0)
"""If the log Bayes factor (nats) of a single power of the amplitude against all sums is larger, an envelope has the
grade `DEVIATES`, and its decay rates are drawn from the power law too, unless a sum is decided or there are fewer than
`FEW_READINGS` readings."""
UNEXPLAINED = 0.05
"""The grade is `DEVIATES` if the rms residual beyond the noise is larger than this fraction of the amplitude."""
UNDESCRIBED = 0.5
"""No damping model describes the record if the rms residual beyond the noise is larger than this fraction of the
amplitude (conventional: half)."""
OTHER_MOTION = 0.05
"""Size of a second oscillation or of a growth, relative to the amplitude of the first oscillation, from which the
record is not a free decay of one oscillator."""
SMALL_OTHER_MOTION = 0.01
"""Smaller limit in place of `OTHER_MOTION`, if no law of one oscillator fits the record but two oscillations explain it
to its noise (conventional)."""
REMARK = 0.01
"""There is a remark if the rms residual beyond the noise is at least this fraction of the amplitude."""
EXTRAPOLATED = 0.005
"""Relative difference between the natural frequency and the frequency at an amplitude of the record, or relative half
interval of the natural frequency, from which the natural frequency is given only as an extrapolation (conventional)."""
UNDETERMINED = 0.05
"""The natural frequency is omitted, as not determined, if its 95 % interval is wider than this fraction of it
(conventional)."""
FREQUENCIES_DIFFER = 1.05
"""Records of one specimen have different natural frequencies if the 95 % intervals of two of them are further apart
than this factor (conventional)."""
MIDLINE = 0.002
"""Drift of the midline, as a fraction of the first amplitude, from which there is a remark (usual linearity of
sensors)."""
TWIN = 0.3
"""Upper limit of the energy fraction of a term's twin (a term with the same loss at every amplitude) from which a sum
without the twin is not named without reservation (conventional)."""
TERM_SURE = 0.95
"""The sentence says that a term is sure if all sums with it together have at least this probability."""
EXPONENT_NAMED = 0.3
"""The sentence names the law with an exponent only if half the exponent's 95 % interval is at most this."""
EXPONENT_MARGIN = 0.02
"""The interval of the exponent is widened by this at both ends before laws are sought whose exponents it contains
(conventional)."""
HARDLY_FALLS = 0.7
"""If the last amplitude is more than this fraction of the first, a remark says that damping models are hard to
distinguish."""
FEW_READINGS = 20
"""With fewer readings than this, the noise of an envelope is hardly known: a remark says so, and no power law replaces
the sums."""
SHALLOW = 10.0
"""If an envelope falls by less than this, in dB, a remark says that damping models are hard to distinguish."""
AGREEMENT_SDS = 0.5
"""Two computations agree if a damping ratio or coefficient changes by less than this many of the answer's standard
deviations."""
WIDTHS_AGREE = 1.25
"""Factor by which the widths of the 95 % intervals of two computations may differ if they agree: with a few hundred
draws, each end of an interval varies by a tenth of the width."""
AVERAGED = 0.1
"""If averaging a long record over cycles shifts a parameter by more than this many posterior standard deviations, the
remark on it is a reservation; otherwise it only informs."""
