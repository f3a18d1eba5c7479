"""The two ways to ask: Monte Carlo and linear covariance, on the same kernels."""
