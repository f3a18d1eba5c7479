"""Definition of a campaign: schema, axes and cases, published numbers, corridor. Read `schema.py` first."""
