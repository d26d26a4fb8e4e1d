"""An estimator that kills its process, like one that needs more memory than the machine has."""

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
