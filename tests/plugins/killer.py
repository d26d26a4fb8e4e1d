"""An estimator that takes its process with it, as one that asks for more memory than there is."""

import os
import signal

from bayesdamp.estimators import Estimator, Options


class Killer(Estimator):
    name = "killer"
    options = Options

    def refuses(self, damping):
        return None

    def initial(self, signal_, problem, options, rng):
        os.kill(os.getpid(), signal.SIGKILL)


PLUGIN = Killer()
