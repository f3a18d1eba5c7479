"""Parquet tables: their dictionary, how they are written while a campaign runs, and read back.

While a campaign runs: ``results = write.open_results(folder, name, resolved_yaml, manifest, "resume")``; each worker
calls ``results.write_block(case_id, summary)`` (or ``parts.write`` where the object is not at hand); at the end, in the
order of the plan, ``results.write_case(case, prepared_case, cov, results.block_summaries(case_id))`` and
``results.finish({...})``. Afterwards: ``tables = read.load(folder)``; ``tables.history`` is a pandas frame. Modules
that only write do not import `read`, so that a worker does not load pandas into memory.
"""
