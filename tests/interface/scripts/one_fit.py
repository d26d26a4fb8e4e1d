"""One model on one record."""

import bayesdamp as bd

signal = bd.simulate({"viscous": 0.05}, "linear", stiffness=20.0, duration=6.0, samples=150, noise_sd=0.003)
model = bd.Model("viscous", "linear", noise="gaussian", priors={"viscous": bd.HalfNormal(0.5)})
fit = bd.fit(signal, model)
print(fit)
print(f"zeta = {fit.values['zeta']:.4f} ± {fit.sd['zeta']:.4f} {fit.units['zeta']}")
fit.plot()
