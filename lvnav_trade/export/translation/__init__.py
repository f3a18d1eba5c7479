"""Kernels as C99: their own source, for arguments whose shapes and settings are known. Read `program.py` first."""
