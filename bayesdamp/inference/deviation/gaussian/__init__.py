"""The linear Gaussian model of a record about a motion, with deviations of the forces."""
