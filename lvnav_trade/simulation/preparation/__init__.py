"""A scenario made ready for both engines, stage by stage.

Read `prepare.py` first; `inputs.py` has the records that kernels read.
"""
