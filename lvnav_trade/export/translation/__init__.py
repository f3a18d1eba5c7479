"""Translation of kernels to C99 for arguments with known shapes and settings. Read `program.py` first."""
