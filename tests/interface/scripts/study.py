"""A study from a dictionary, and its tables."""
# pyright: reportUnknownArgumentType=false

import bayesdamp as bd

numbers = {"stiffness": 20.0, "rest_angle": 0.0, "theta0": 0.3, "omega0": 0.0}
truth = {"viscous": 0.05, "duration": 6.0, "samples": 150, "noise_sd": 0.003}
study = {"version": 1, "name": "small", "system": {"restoring": "linear", **numbers}}
study |= {"signal": [{"name": "bench", "simulate": truth}], "models": {"compare": ["viscous", "quadratic"]}}
study |= {
    "estimators": {"use": ["koopman"]},
    "posterior": {"samplers": []},
    "evidence": {"methods": ["importance"]},
}
run = bd.run_study(study, "small")
print(run.evidence[["model", "log_evidence", "probability"]])
print(run.candidate("bench", "viscous").evidence["importance"].log_evidence)
