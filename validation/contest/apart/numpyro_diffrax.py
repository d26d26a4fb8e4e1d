"""Sample the posterior with NumPyro's NUTS and trajectories by diffrax, as an expert on the three dampings would do it.

The model has a spring with a cubic term, viscous, Coulomb (tanh) and quadratic damping together, and white noise. The
spectral peak sets the unit of time, and the largest displacement is the unit of displacement. With these parameters
NUTS does not finish with its defaults, because their standard deviations are a thousand times smaller than those of
the priors. So it starts at the least-squares solution and samples in units of its covariance. There are 250 warm-up
steps and 250 draws of one chain; the interval is 2.5 to 97.5 % of the draws.
"""

import diffrax  # pyright: ignore[reportMissingImports]
import jax
import jax.numpy as jnp
import numpy as np
import numpyro
from numpyro import distributions as dist
from numpyro.infer import MCMC, NUTS, init_to_value
from scipy.optimize import least_squares
from serve import serve
from shared import even, fit_sinusoid, ratio, spectral_peak

jax.config.update("jax_enable_x64", True)
WIDTH = 0.02
"""Width of the smoothed sign in Coulomb friction, as a share of the peak velocity."""
STEPS = 250
WIDE = 10.0
"""Standard deviation of the priors, in standard deviations of the least-squares solution; nearly uninformative."""
LIMIT = 180.0


def field(_, state, p):
    """Return the time derivatives of `state`, displacement and velocity, for parameters `p` by name."""
    x, v = state
    spring = p["stiffness"] * x + p["cubic"] * x**3
    loss = 2 * p["viscous"] * v + p["coulomb"] * jnp.tanh(v / WIDTH) + p["quadratic"] * v * jnp.abs(v)
    return v, -spring - loss


def motion(p, times):
    """Return the displacements from rest at `times`, the first of which is 0, for parameters `p` by name."""
    solution = diffrax.diffeqsolve(
        diffrax.ODETerm(field), diffrax.Tsit5(), t0=0.0, t1=times[-1], dt0=0.05, y0=(p["x0"], p["v0"]), args=p,
        saveat=diffrax.SaveAt(ts=times), stepsize_controller=diffrax.PIDController(rtol=1e-6, atol=1e-6),
        adjoint=diffrax.ForwardMode(), max_steps=10_000, throw=False,
    )  # fmt: skip
    assert solution.ys is not None  # because of SaveAt(ts=...)
    return solution.ys[0]


NAMES = ("viscous", "coulomb", "quadratic", "stiffness", "cubic", "x0", "v0", "rest")
GUESS = (0.02, 0.0, 0.0, 1.0, 0.0)


def curve(x, times):
    """Return the displacements at `times` for a vector `x` of parameters in the order of NAMES."""
    p = dict(zip(NAMES, x, strict=True))
    return motion(p, times) + p["rest"]


def model(times, values, middle, scale, left):
    """Define the NumPyro model: wide normal priors about the least-squares solution, and the likelihood.

    times, values: the record in normalised units. middle, scale, left: results of `fit_least_squares`.
    """
    z = numpyro.sample("z", dist.Normal(0.0, WIDE).expand([len(NAMES)]))
    noise = left * jnp.exp(numpyro.sample("log_noise", dist.Normal(0.0, WIDE)) / jnp.sqrt(2.0 * values.size))
    x = numpyro.deterministic("x", middle + scale @ z)
    numpyro.sample("y", dist.Normal(curve(x, times), noise), obs=values)


def fit_least_squares(times, values):
    """Return the least-squares solution (k,), a matrix square root of its covariance (k, k), and the residuals' sd."""
    solve = jax.jit(lambda x: curve(x, times))
    slope = jax.jit(jax.jacfwd(lambda x: curve(x, times)))
    inside = np.asarray(times) <= 2 * np.pi
    first = fit_sinusoid(np.asarray(times)[inside], np.asarray(values)[inside])
    x_scale = np.array([0.01, 0.01, 0.01, 0.01, 0.1, 1.0, 1.0, 1.0])
    best = least_squares(
        lambda x: np.nan_to_num(np.asarray(solve(x) - values), posinf=1e3, neginf=-1e3),
        np.array([*GUESS, *first[:2], 0.0]),
        jac=lambda x: np.nan_to_num(np.asarray(slope(x)), posinf=0.0, neginf=0.0),  # pyright: ignore[reportArgumentType]
        x_scale=x_scale,
    )
    size = np.sqrt(2 * best.cost / (values.size - len(NAMES)))
    _, s, vt = np.linalg.svd(best.jac * x_scale, full_matrices=False)
    return best.x, size * x_scale[:, None] * vt.T / s, size


def answer(t, y, amplitudes):
    """Return the damping ratios at amplitudes (rad) for a record (t in s, y in rad), as `serve` requires.

    They are a dictionary with lists: "values" are medians of the draws, "low" and "high" the ends of 95 % intervals.
    """
    omega = 2 * np.pi * spectral_peak(*even(t, y))
    rest = float(np.mean(y))
    size = float(np.max(np.abs(y - rest)))
    times, values = jnp.asarray(omega * (t - t[0])), jnp.asarray((y - rest) / size)
    middle, scale, left = fit_least_squares(times, values)
    begin = init_to_value(values={"z": jnp.zeros(len(NAMES)), "log_noise": 0.0})
    kernel = NUTS(model, forward_mode_differentiation=True, init_strategy=begin)
    mcmc = MCMC(kernel, num_warmup=STEPS, num_samples=STEPS, progress_bar=False)
    mcmc.run(jax.random.PRNGKey(0), times, values, jnp.asarray(middle), jnp.asarray(scale), left)
    draws = dict(zip(NAMES, np.asarray(mcmc.get_samples()["x"]).T, strict=True))
    reply = {"values": [], "low": [], "high": []}
    for amplitude in np.asarray(amplitudes) / size:
        frequency = np.sqrt(draws["stiffness"] + 0.75 * draws["cubic"] * amplitude**2)
        terms = {name: draws[name] for name in ("viscous", "coulomb", "quadratic")}
        at = ratio(amplitude, frequency, **terms)
        for name, part in (("low", 2.5), ("values", 50), ("high", 97.5)):
            reply[name].append(float(np.percentile(at, part)))
    return reply


if __name__ == "__main__":
    serve(answer, LIMIT)
