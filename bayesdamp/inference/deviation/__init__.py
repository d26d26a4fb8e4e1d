"""Laws that hold approximately: fits, evidence and intervals with relative deviations of the forces integrated out.

The model of a record y at times t is

    θ̈ = −e^g(t) Σ c_i f_i(θ, θ̇) − (1 + 2 h(t)) F(θ),    y = θ + noise,

with damping terms f_i and their coefficients c_i ≥ 0, a restoring force F, and deviations of the damping, g, and of
the frequency, h, along the record. Every inferred parameter is a function of a standard normal score; coefficients
may share a prior scale. With probability 0.8 a law holds exactly, and its deviation is 0. Else the deviation is a
Gaussian process whose size and correlation length have priors of their own (`gaussian.hyperparameters`); e^g and h
are linear between knots. u = (scores, g and h at the knots) contains all unknowns.

Near a motion the record is nearly linear in u. Under each combination of sizes and lengths, evidence and posterior of
the linear model have closed forms, apart from the probability that no coefficient is negative (`gaussian.linear`);
the combinations are summed over. The modules:

- `data`, `averaged`, `sample_noise`: the record, its averages, and the noise of its samples.
- `parameters`, `least_squares`, `candidate`: scores, the fit under exact laws, the linear model about the mode.
- `weighing`, `quick`: all candidates on one record. `sampling`, `ridge`: the motions themselves instead of the model.
- `numbers`, `findings`, `picture`: ratios, shares and bounds from draws.
- `single`: one candidate with its density. `specimen`: one damping from several records.
"""
