"""Running a campaign: plan, work items, workers, stopping, progress, status, replay. Read `execute.py` first."""
