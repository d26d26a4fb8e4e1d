"""Define the peers that run in the environment of bayesdamp: functions from a record and amplitudes to a `Reply`."""
