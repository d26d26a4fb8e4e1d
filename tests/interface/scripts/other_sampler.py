"""The posterior under a sampler from elsewhere: emcee, all walkers at once."""
# pyright: reportUnknownMemberType=false, reportMissingTypeStubs=false, reportUnknownArgumentType=false, reportOptionalMemberAccess=false

import emcee
import numpy as np

import bayesdamp as bd

signal = bd.simulate({"viscous": 0.05}, "linear", stiffness=20.0, duration=6.0, samples=150, noise_sd=0.003)
fit = bd.fit(signal, bd.Model("viscous", "linear", noise="gaussian"))
density, sds = fit.density, np.array(list(fit.sd.values()))
start = density.vector() + 0.1 * sds * np.random.default_rng(0).standard_normal((32, sds.size))
sampler = emcee.EnsembleSampler(32, sds.size, density.log_posteriors, vectorize=True)
sampler.run_mcmc(start, 200)
print(dict(zip(density.names, sampler.get_chain(discard=100, flat=True).mean(axis=0))))
