"""Several records in a loop."""
# pyright: reportMissingTypeStubs=false

import pandas as pd

import bayesdamp as bd

model, rows = bd.Model("viscous", "linear", noise="gaussian"), dict[str, dict[str, float]]()
for i, zeta in enumerate((0.03, 0.05, 0.08)):
    truth = {"viscous": zeta}
    signal = bd.simulate(
        truth, stiffness=20.0, duration=6.0, samples=150, noise_sd=0.003, seed=i, name=f"run {i}"
    )
    fit = bd.fit(signal, model)
    rows[signal.name] = {"zeta": fit.values["zeta"], "sd": fit.sd["zeta"], "truth": zeta}
print(pd.DataFrame(rows).T)
