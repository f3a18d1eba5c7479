"""Published numbers and orders of cases, compared with those of a study's campaigns. Read `published.py` first."""
