"""Two engines on the same kernels: `setup` prepares a case, `simulate` runs it, `lincov` propagates its covariance."""
