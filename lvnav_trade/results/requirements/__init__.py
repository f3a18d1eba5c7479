"""Requirements: verdicts, margins, confirmation, and which error sources must improve to meet them.

Read `requirements.py` first.
"""
