"""One epoch of a filter, the same for a run and for the joint covariance: what enters, in what order, and where to."""
