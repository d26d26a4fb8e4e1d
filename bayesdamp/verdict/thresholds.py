"""Define every threshold that decides on a verdict, the answer on a record.

The thresholds were chosen on simulated records with the random seeds 1 to 9. The accuracy that the documents report was
measured on records with other seeds.
"""

from math import log

DECIDED = 0.95
"""One damping is named without reservation only if its probability is at least this (conventional)."""
CAP = 0.99
"""Largest probability of a damping or a restoring law that a verdict gives for a measured record, unless its laws are
assumed to hold exactly; for an envelope or several records it always applies. Measured on records whose laws do not
hold exactly: nine in ten statements with a probability above 0.95 were right."""
NAMED = 0.05
"""If a verdict does not decide on a damping, its sentence mentions up to two other dampings whose probability is at
least this. The sentence on the energy mentions another form of damping from the same probability."""
EXACT = 0.03
"""The grade is exact if the 95 % interval of the deviation from the damping law (a fraction) ends at or below this,
unless another limit makes it `DEVIATES`. For envelopes see `LIKELY_EXACT`."""
DEVIATES = 0.25
"""If the deviation from the damping law is larger than this fraction, the grade is `DEVIATES`: no law is named as the
answer. The median of the deviation is compared; for an envelope its 97.5 % quantile, unless its grade is exact. The
same limit decides at which amplitude the damping surely differs from that of its law (`Verdict.over_law`)."""
RESTORING_DEVIATES = 0.05
"""The grade is `DEVIATES` if the 95 % interval of the deviation from the restoring law (a fraction) begins above
this."""
CONTRADICTS, WIDER = 0.05, 2.0
"""Two limits that decide whether a record contradicts a damping law. The damping ratio of the law must differ by more
than the fraction `CONTRADICTS` from the ratio that is measured without a law. The two 95 % intervals must not overlap,
even if the measured interval is widened by the factor `WIDER`. Smaller differences may be due to the approximations of
the measurement (measured: none of 55 simulated records is contradicted)."""
SPRING_DEVIATES, CONTRADICTS_THEN = 0.002, 0.02
"""If the 95 % interval of the deviation from a nonlinear restoring law begins above the fraction `SPRING_DEVIATES`, the
law may only imitate another motion, such as a second mode near a multiple of the frequency. No damping is then named
without reservation, and `CONTRADICTS_THEN` replaces `CONTRADICTS`. (In 53 simulated records of one oscillator whose
damping is named the interval begins below 0.0002, in 7 records with a second mode that were named wrongly above
0.002.)"""
SAME_AMPLITUDE = 0.05
"""Two amplitudes count as the same if their natural logarithms differ by less than this."""
CONTRADICTS_FREQUENCY = 0.002
"""A record contradicts a restoring law if the law's frequency differs by more than this fraction from the frequency
that is measured without a law. The two 95 % intervals must also not overlap, even if the measured interval is widened
by the factor `WIDER`."""
LIKELY_EXACT = 0.5
"""The grade of an envelope is exact if the probability that a damping law holds exactly is at least this."""
POWER_LAW = log(20.0)
"""Limit in nats of the log Bayes factor of a single power of the amplitude against all sums of damping terms, for an
envelope. If the factor is larger, the grade is `DEVIATES`, and decay rates are drawn from the power law too. This does
not apply if one sum is probable enough (`DECIDED`) and holds well enough to be named, or if there are fewer than
`FEW_READINGS` readings."""
UNEXPLAINED = 0.05
"""The grade is `DEVIATES` if the rms residual beyond the noise is larger than this fraction of the first amplitude."""
UNDESCRIBED = 0.5
"""The verdict says that no damping model describes the record if the rms residual beyond the noise is larger than this
fraction of the first amplitude, or for an envelope of the amplitude (conventional: half)."""
OTHER_MOTION = 0.05
"""A record is not the free decay of one oscillator if the amplitude of a second oscillation, or the growth of the
amplitude, is at least this fraction of the amplitude of the first oscillation."""
SMALL_OTHER_MOTION = 0.01
"""Limit that replaces `OTHER_MOTION` if no law of one oscillator fits the record, but two oscillations explain it to
its noise (conventional)."""
REMARK = 0.01
"""A remark mentions the rms residual beyond the noise if it is at least this fraction of the first amplitude. If no law
is the answer, the record is then searched again for a second oscillation (`no_free_decay`)."""
EXTRAPOLATED = 0.005
"""The natural frequency is given only as an extrapolation if it differs by more than this fraction from the frequency
at an amplitude of the record, or if half its 95 % interval is more than this fraction of it (conventional)."""
UNDETERMINED = 0.05
"""The natural frequency is omitted, as not determined, if its 95 % interval is wider than this fraction of it
(conventional)."""
FREQUENCIES_DIFFER = 1.05
"""Records of one specimen count as having different natural frequencies if, for two of them, the lower end of the one
95 % interval is more than this factor times the upper end of the other (conventional)."""
MIDLINE = 0.002
"""A remark mentions a drift of the midline if it is at least this fraction of the first amplitude (usual linearity of
sensors)."""
TWIN = 0.3
"""A twin of a damping term is another term with the same energy loss at every amplitude. If the 95 % upper limit of the
twin's fraction of the energy is at least this, a sum without the twin is named only with reservation (conventional)."""
TERM_SURE = 0.95
"""If a verdict does not decide on a damping, its sentence says that the damping surely contains a term if all dampings
with this term together have at least this probability among the compared models."""
EXPONENT_NAMED = 0.3
"""The sentence on a power law of the damping force names the damping with this exponent (Coulomb 0, viscous 1,
quadratic 2) only if half the exponent's 95 % interval is at most this."""
EXPONENT_MARGIN = 0.02
"""The 95 % interval of the exponent of a power law is widened by this at both ends before it is checked whether it
contains the exponent of Coulomb, viscous or quadratic damping (conventional)."""
HARDLY_FALLS = 0.7
"""If the last amplitude is more than this fraction of the first, a remark says that damping models are hard to
distinguish."""
FEW_READINGS = 20
"""With fewer readings than this, the noise of an envelope is hardly known. A remark says so, and decay rates are not
drawn from a power law (see `POWER_LAW`)."""
SHALLOW = 10.0
"""If an envelope falls by less than this, in dB, a remark says that damping models are hard to distinguish."""
AGREEMENT_SDS = 0.5
"""Two computations agree if a damping ratio or coefficient differs by less than this many standard deviations of the
answer."""
WIDTHS_AGREE = 1.25
"""Factor by which the widths of the 95 % intervals of two computations may differ if they agree: with a few hundred
draws, each end of an interval varies by a tenth of the width."""
AVERAGED = 0.1
"""Limit in posterior standard deviations of a parameter. If averaging a long record over cycles shifts a parameter by
more than this, the remark on the averaging is a reservation; otherwise it is only information."""
