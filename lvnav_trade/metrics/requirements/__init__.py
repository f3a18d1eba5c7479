"""Requirements: verdicts, and which error sources must improve to meet them. Read `requirements.py` first."""
