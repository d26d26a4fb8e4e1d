"""Laws that hold approximately: fits, evidence and intervals with relative deviations of the forces integrated out.

The model of a record y at times t is

    θ̈ = −e^g(t) Σ c_i f_i(θ, θ̇) − (1 + 2 h(t)) F(θ),    y = θ + noise,

with damping terms f_i and their coefficients c_i ≥ 0, a restoring force F, and deviations of the damping, g, and of
the frequency, h, along the record. Every inferred parameter is a function of a standard normal score; coefficients
may share a prior scale. With probability 0.8 a law holds exactly, and its deviation is 0. Else the deviation is a
Gaussian process whose size and correlation length have priors of their own (`linear.Grid`); e^g and h are linear
between knots. u = (scores, g and h at the knots) contains all unknowns.

Near a motion the record is nearly linear in u. Under each combination of sizes and lengths, evidence and posterior of
the linear model have closed forms, apart from the probability that no coefficient is negative (`linear`); the
combinations are summed over.

The way of a record, which `quick.weighing_of` follows from its samples to a `Weighing`:

1. Data. `data`: the samples, or means over short windows. `averaged`: amplitudes and phases of very many cycles.
   `sample_noise`: the noise of the samples.
2. Fit. `parameters`: scores. `least_squares`: the fit under exact laws. `candidate`: a damping sum under a restoring
   law, its fit, and its linear model about the mode.
3. Weigh. `weighing`: all candidates. `forms`: forms of damping that are not compared. `exponent`: of a power law.
4. Sample. `sampling`: the motions themselves instead of the linear model, with the sampler of `tempered` and the
   coordinates of `ridge`.
5. Findings. `draws`, `free`: draws of candidates, and the damping at an amplitude by law and without one.
   `findings`: the numbers of a verdict and the arrays of a picture.

`single` is one candidate with its density. `specimen` weighs one damping on several records, which `repeats` joins.
"""
