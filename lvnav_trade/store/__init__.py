"""Results of a campaign on disk: Parquet tables (`schema`), writing and reading.

While a campaign runs: ``results = write.open_results(folder, name, resolved_yaml, manifest, "resume")``. Each worker
calls ``results.write_part(case_id, summary)``, or ``parts.write`` if it does not have the object. At the end, in the
order of the plan, ``results.write_case(case, prepared, cov, results.parts(case_id))`` and ``results.finish({...})``.
Afterwards ``tables = read.load(folder)``, and ``tables.history`` is a pandas frame. Modules that only write do not
import `read`, so that workers need not load pandas.
"""
