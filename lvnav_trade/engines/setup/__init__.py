"""A scenario made ready for both engines: start with `prepare.py`; `inputs.py` has the records that kernels read."""
