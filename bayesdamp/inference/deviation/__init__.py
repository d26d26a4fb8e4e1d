"""Bayesian comparison of damping models whose laws hold approximately.

The model of a record y at times t is

    θ̈ = −exp(g(t)) Σ c_i f_i(θ, θ̇) − (1 + 2 h(t)) F(θ),    y = θ + noise.

θ is the displacement, an angle or a length. If the record is a velocity or an acceleration, θ̇ or θ̈ replaces θ in y.

Words
-----
- *damping sum*: a sum of damping terms c_i f_i with coefficients c_i ≥ 0. A term may have *own parameters* besides its
  coefficient, such as an exponent. Coefficients may have half-normal priors with a common, unknown scale.
- *restoring law*: the force F with its parameters. *candidate*: a damping sum under a restoring law.
- *motion*: a solution of the equation above, in the form in which the record's values are fitted (see step 1 below).
- *score*: a number z that stands for a parameter and has the prior N(0, 1). The parameter is a function of z, which is
  defined by the parameter's prior.
- *deviations*: g, the log deviation of the damping, and h, the relative deviation of the frequency. Both change
  linearly in time between equidistant *knots*. u = (scores, g and h at the knots) contains all unknowns of a candidate.
- *exact laws*: g = h = 0. Each of g and h has prior probability 0.8 to be 0; otherwise it is a Gaussian process.
- *hyperparameters*: the sizes (prior standard deviations) and the correlation lengths of g and h. The evidence is
  summed over a grid of them (`linear.Grid`). *grid point*: one combination of hyperparameters.
- *linear posterior*: near a motion the record is nearly linear in u. At each grid point this linear model has a normal
  posterior, cut off where coefficients would be negative. The linear posterior is their mixture over the grid.
- *evidence*: the probability density of the record under a candidate, with all parameters integrated out.
- *other form*: a form of damping that no compared sum contains. *rival*: a sum with another form. The evidence of
  rivals is computed after that of the candidates.

Modules
-------
`compare.compare_signal` leads from a record to a `ModelComparison` in these steps:

1. Data. `data`: the samples, or means over short windows. `averaged`: amplitudes and phases of very many cycles.
   `sample_noise`: the noise model of the samples.
2. Fit. `parameters`: priors and scores. `least_squares`: the fit under exact laws. `candidate`: linearisation about the
   mode.
3. Compare. `linear`: posterior and evidence of a linear model. `model_comparison`: all candidates. `forms`: rivals, and
   limits for other forms. `slices`: the exponent of a power law.

Further steps use this comparison:

4. Sample. `sampling` draws from the posterior and solves the motion of each draw, with the sampler of `tempered`. It
   starts from a linear posterior. If a damping term has own parameters, it may start from several (`slices`).
5. Findings. `draws`: damping ratio at an amplitude. `findings`: the numbers of a verdict and the arrays of a picture.

`single` fits one candidate and computes its posterior density. `specimen` compares dampings on several records of one
specimen, and `repeats` computes their joint posterior.
"""
