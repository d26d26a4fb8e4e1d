"""bayesdamp: how large is the damping of a decaying oscillation, which is it, and how sure may one be?"""

import jax

jax.config.update("jax_enable_x64", True)

__version__ = "0.1.0"
