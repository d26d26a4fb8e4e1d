"""Saving and loading results, and the draws for others."""
# pyright: reportUnknownMemberType=false

import bayesdamp as bd

signal = bd.simulate({"viscous": 0.05}, "linear", stiffness=20.0, duration=6.0, samples=150, noise_sd=0.003)
post = bd.sample(bd.fit(signal, bd.Model("viscous", noise="gaussian")), warmup=100, draws=100)
path = post.save("viscous.post")
again = bd.Posterior.load(path)
assert (again.draws == post.draws).all()
assert bd.load(path).fit.values == post.fit.values
again.data.to_netcdf("viscous.nc", engine="h5netcdf")
