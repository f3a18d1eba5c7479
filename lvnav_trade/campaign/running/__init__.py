"""Running a campaign: plan, work items, workers, stopping, progress, status, replay.

Read `execute.py` first. A resumed campaign skips the stored blocks, which
`results.tables.write.ResultsWriter.block_spans` finds.
"""
