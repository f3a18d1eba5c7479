"""From question to stored runs."""
