"""Campaigns of many designs: one row each by linear covariance, and which of them are analysed whole."""
