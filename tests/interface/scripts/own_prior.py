"""Three specimens whose dampings share a distribution: a hierarchy, in NumPyro."""
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false, reportMissingTypeStubs=false

import jax
from numpyro import infer, sample
from numpyro.distributions import LogNormal, Normal

import bayesdamp as bd

densities = list[bd.Density]()
for zeta in (0.04, 0.05, 0.06):
    body = bd.simulate({"viscous": zeta}, stiffness=20.0, duration=6.0, samples=100, noise_sd=0.003)
    densities.append(bd.Model("viscous", noise="gaussian").bind(body))


def together() -> None:
    middle = sample("log_middle", Normal(-3.0, 1.0))
    for i, density in enumerate(densities):
        density.numpyro(prefix=f"{i}/")(zeta=sample(f"zeta_{i}", LogNormal(middle, 0.3)))


mcmc = infer.MCMC(infer.NUTS(together, max_tree_depth=6), num_warmup=100, num_samples=100, progress_bar=False)
mcmc.run(jax.random.key(0))
