"""The motion beyond the record, with its band."""
# pyright: reportUnknownMemberType=false

import matplotlib.pyplot as plt
import numpy as np

import bayesdamp as bd

signal = bd.simulate({"viscous": 0.05}, "linear", stiffness=20.0, duration=6.0, samples=150, noise_sd=0.003)
fit = bd.fit(signal, bd.Model("viscous", "linear", noise="gaussian"))
ahead = fit.predict(np.linspace(6.0, 12.0, 200))
figure, ax = plt.subplots()
signal.plot(ax)
ax.fill_between(ahead.t, ahead.value - 2 * ahead.sd, ahead.value + 2 * ahead.sd)
figure.savefig("ahead.png")
