"""Errors that a user can mend: one line that says where and what."""

from __future__ import annotations


class InputError(Exception):
    """Bad usage or bad input; the command line prints it in one line and leaves with exit code 2."""
