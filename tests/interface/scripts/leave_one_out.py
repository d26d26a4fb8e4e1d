"""Leave-one-out cross-validation of two models, with ArviZ."""
# pyright: reportUnknownMemberType=false, reportPrivateImportUsage=false, reportUnknownArgumentType=false

import arviz_stats as az

import bayesdamp as bd

signal = bd.simulate({"viscous": 0.05}, "linear", stiffness=20.0, duration=6.0, samples=150, noise_sd=0.003)
for damping in ("viscous", "quadratic"):
    fit = bd.fit(signal, bd.Model(damping, "linear", noise="gaussian"))
    print(damping, az.loo(bd.sample(fit, warmup=100, draws=200).data), sep="\n")
