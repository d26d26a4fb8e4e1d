"""Bayesian comparison of damping models whose laws hold approximately.

The model of a record y at times t is

    θ̈ = −e^g(t) Σ c_i f_i(θ, θ̇) − (1 + 2 h(t)) F(θ),    y = θ + noise.

Words
-----
- *damping sum*: a sum of damping terms c_i f_i with coefficients c_i ≥ 0. A term may have *own parameters* besides its
  coefficient, such as an exponent. Coefficients may have half-normal priors with a common, unknown scale.
- *restoring law*: the force F with its parameters. *candidate*: a damping sum under a restoring law.
- *motion*: a solution of the equation above, at the samples of the record.
- *score*: the standard normal score z of a parameter. Its prior maps z ~ N(0, 1) to the parameter.
- *deviations*: g, the log deviation of the damping, and h, the relative deviation of the frequency. They are linear
  between equidistant *knots*. u = (scores, g and h at the knots) contains all unknowns of a candidate.
- *exact laws*: g = h = 0. Each of g and h has prior probability 0.8 to be 0; otherwise it is a Gaussian process whose
  size and correlation length (the *hyperparameters*) are summed over a grid (`linear.Grid`).
- *linear posterior*: near a motion the record is nearly linear in u. At each grid point this linear model has a normal
  posterior, cut off where coefficients would be negative. The linear posterior is their mixture over the grid.
- *evidence*: the probability density of the record under a candidate, with all parameters integrated out.
- *other form*: damping that is not in the compared sums. *rival*: a sum with another form, whose evidence is computed
  after that of the candidates.

Modules
-------
`quick.compare_signal` leads from a record to a `ModelComparison` in these steps:

1. Data. `data`: the samples, or means over short windows. `averaged`: amplitudes and phases of very many cycles.
   `sample_noise`: the noise model of the samples.
2. Fit. `parameters`: priors and scores. `least_squares`: the fit under exact laws. `candidate`: linearisation about the
   mode.
3. Compare. `linear`: posterior and evidence of a linear model. `model_comparison`: all candidates. `forms`: rivals, and
   limits for other forms. `slices`: the exponent of a power law.
4. Sample. `sampling`: draws of the motions instead of the linear model, with the sampler of `tempered`, from
   the linear models of `slices` where a damping term has a parameter of its own.
5. Findings. `draws`: damping ratio at an amplitude. `findings`: the numbers of a verdict and the arrays of a picture.

`single` is one candidate and its probability density. `specimen` compares one damping on several records, which
`repeats` joins.
"""
