"""A posterior and its trace plot."""
# pyright: reportUnknownMemberType=false

import matplotlib.pyplot as plt

import bayesdamp as bd

signal = bd.simulate({"viscous": 0.05}, "linear", stiffness=20.0, duration=6.0, samples=150, noise_sd=0.003)
fit = bd.fit(signal, bd.Model("viscous", "linear", noise="gaussian"))
post = bd.sample(fit, chains=4, warmup=100, draws=200, seed=1)
print(post.summary())
post.plot(names=["zeta", "noise_sd"])
plt.savefig("traces.png")
