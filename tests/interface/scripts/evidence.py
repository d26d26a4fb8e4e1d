"""The evidence of two models, and the odds between them."""

import math

import bayesdamp as bd

signal = bd.simulate({"viscous": 0.05}, "linear", stiffness=20.0, duration=6.0, samples=150, noise_sd=0.003)
viscous = bd.evidence(bd.fit(signal, bd.Model("viscous", noise="gaussian")), "importance")
both = bd.evidence(bd.fit(signal, bd.Model("viscous+coulomb", noise="gaussian")), "importance")
print(viscous, both, sep="\n")
print(f"viscous alone is {math.exp(viscous.log_evidence - both.log_evidence):.3g} times as likely")
