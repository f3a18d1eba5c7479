"""Design spaces: many designs with one row each by linear covariance, and a full analysis of a selection of them."""
