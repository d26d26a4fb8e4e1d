"""Laws that hold approximately: fits, evidence and intervals with relative deviations of the forces integrated out."""
