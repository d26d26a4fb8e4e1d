"""One of the eleven estimators, at both stages."""

import bayesdamp as bd

signal = bd.simulate({"viscous": 0.05}, "linear", stiffness=20.0, duration=6.0, samples=150, noise_sd=0.003)
model = bd.Model("viscous", "linear", noise="gaussian")
estimate = bd.estimate(signal, "koopman", model)
print(estimate)
print(estimate.initial.values["zeta"], estimate.refined.values["zeta"], estimate.outcome)
estimate.plot()
