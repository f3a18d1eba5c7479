"""Campaigns: reading of the files, cases, runs, searches over designs, design spaces."""
