"""Running a campaign: plan, work items, workers, stopping, progress, status, replay.

Read `execute.py` first. A resumed campaign skips the blocks that `results.tables.write.ResultsWriter.done` finds.
"""
