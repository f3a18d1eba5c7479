"""What a campaign is: its schema, axes and cases, published numbers, corridor. Read `schema.py` first."""
