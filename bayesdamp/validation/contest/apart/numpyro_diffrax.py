"""NumPyro's NUTS on a likelihood that diffrax solves, as somebody would write it who knows the three dampings.

A spring with a cubic term, viscous, Coulomb (tanh) and quadratic damping together, white noise; time in units of the
spectrum's peak and displacement in units of the largest one. 500 warm-up steps and 500 draws of one chain, everything
else by default. The interval is of 2.5 to 97.5 % of the draws.
"""

import diffrax  # pyright: ignore[reportMissingImports]
import jax
import jax.numpy as jnp
import numpy as np
import numpyro
from equivalent import ratio
from numpyro import distributions as dist
from numpyro.infer import MCMC, NUTS, init_to_median
from serve import serve

jax.config.update("jax_enable_x64", True)
WIDTH = 0.02
"""Of friction's turning over, of the peak velocity."""
STEPS = 500
PADDING = 8
LIMIT = 180.0


def spectral_peak(t, y):
    """Frequency in rad/s of the largest line."""
    grid = np.linspace(t[0], t[-1], t.size)
    values = np.interp(grid, t, y)
    power = np.abs(np.fft.rfft((values - values.mean()) * np.hanning(t.size), PADDING * t.size))
    return 2 * np.pi * (np.argmax(power[PADDING:]) + PADDING) / (PADDING * t.size * (grid[1] - grid[0]))


def field(_, state, p):
    """Slope of displacement and velocity."""
    x, v = state
    spring = p["stiffness"] * x + p["cubic"] * x**3
    loss = 2 * p["viscous"] * v + p["coulomb"] * jnp.tanh(v / WIDTH) + p["quadratic"] * v * jnp.abs(v)
    return v, -spring - loss


def motion(p, times):
    """Displacements at times from 0 on."""
    return diffrax.diffeqsolve(
        diffrax.ODETerm(field), diffrax.Tsit5(), t0=0.0, t1=times[-1], dt0=0.05, y0=(p["x0"], p["v0"]), args=p,
        saveat=diffrax.SaveAt(ts=times), stepsize_controller=diffrax.PIDController(rtol=1e-6, atol=1e-6),
        adjoint=diffrax.ForwardMode(), max_steps=10_000, throw=False,
    ).ys[0]  # fmt: skip


def model(times, values, first):
    """Priors and likelihood."""
    p = {name: numpyro.sample(name, dist.HalfNormal(0.05)) for name in ("viscous", "coulomb", "quadratic")}
    p["stiffness"] = numpyro.sample("stiffness", dist.Normal(1.0, 0.05))
    p["cubic"] = numpyro.sample("cubic", dist.Normal(0.0, 0.2))
    p["x0"] = numpyro.sample("x0", dist.Normal(first[0], 0.1))
    p["v0"] = numpyro.sample("v0", dist.Normal(first[1], 0.1))
    rest = numpyro.sample("rest", dist.Normal(0.0, 0.1))
    noise = numpyro.sample("noise", dist.HalfNormal(0.1))
    numpyro.sample("y", dist.Normal(motion(p, times) + rest, noise), obs=values)


def start(times, values):
    """Displacement and velocity at the first sample, by least squares on the first cycle."""
    inside = times <= 2 * np.pi
    tau = times[inside]
    columns = np.stack([np.cos(tau), np.sin(tau), np.ones_like(tau)], 1)
    return np.linalg.lstsq(columns, values[inside], rcond=None)[0][:2]


def answer(t, y, amplitudes):
    """Ratios with the draws' intervals."""
    omega = spectral_peak(t, y)
    rest = float(np.mean(y))
    size = float(np.max(np.abs(y - rest)))
    times, values = omega * (t - t[0]), (y - rest) / size
    kernel = NUTS(model, forward_mode_differentiation=True, init_strategy=init_to_median)
    mcmc = MCMC(kernel, num_warmup=STEPS, num_samples=STEPS, progress_bar=False)
    mcmc.run(
        jax.random.PRNGKey(0), jnp.asarray(times), jnp.asarray(values), jnp.asarray(start(times, values))
    )
    draws = {name: np.asarray(value) for name, value in mcmc.get_samples().items()}
    said = {"values": [], "low": [], "high": []}
    for amplitude in np.asarray(amplitudes) / size:
        frequency = np.sqrt(draws["stiffness"] + 0.75 * draws["cubic"] * amplitude**2)
        terms = {name: draws[name] for name in ("viscous", "coulomb", "quadratic")}
        at = ratio(amplitude, frequency, **terms)
        for name, part in (("low", 2.5), ("values", 50), ("high", 97.5)):
            said[name].append(float(np.percentile(at, part)))
    return said


if __name__ == "__main__":
    serve(answer, LIMIT)
