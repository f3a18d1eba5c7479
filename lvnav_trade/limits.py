"""Largest sizes that an input may have; whatever is beyond is refused in one line before it costs time or memory."""

from types import MappingProxyType

# --- YAML files: campaigns, cards, studies ----------------------------------------------------------------------------

YAML_BYTES = 2**20
"""Size of a file of settings."""
YAML_NODES = 60_000
"""Words, lists and mappings of a file of settings, those that aliases repeat counted again."""
YAML_DEPTH = 30
"""Lists and mappings within each other."""
YAML_ALIASES = 1_000
"""Aliases in a file of settings."""
WORD_LENGTH = 100_000
"""Characters of a text in a file of settings."""
LIST_LENGTH = 10_000
"""Items of any list of settings."""

# --- data files: trajectories, recordings, almanacs -------------------------------------------------------------------

DATA_BYTES = 2**28
"""Size of a file of data, unpacked."""
DATA_ROWS = 1_000_000
"""Rows of a file of data."""
FIELD_LENGTH = 1_000
"""Characters of a field of a file of data."""

# --- campaigns --------------------------------------------------------------------------------------------------------

AXES = 20
"""Axes of a campaign."""
CASES = 500
"""Cases of a campaign."""
RUNS = 1_000_000
"""Runs of a case."""
FAULTS = 100
"""Faults of a case."""
STATEMENTS = 1_000
"""Requirements, references, orderings or statements on innovations of a campaign."""

# --- quantities -------------------------------------------------------------------------------------------------------

QUANTITY_LENGTH = 80
"""Characters of a quantity."""
EXPONENT = 9.0
"""Exponent of a unit."""
LARGEST = MappingProxyType(
    {"m": 1e12, "s": 1e18, "rad": 1e6, "m/s": 3e8, "rad/s": 1e6, "m/s**2": 1e9, "Hz": 1e12, "kg": 1e12, "K": 1e6}
    | dict.fromkeys(("dB", "dB-Hz", "dBi", "dBW"), 1e3)
)
"""Largest absolute value by SI unit; beyond it a number was mistyped."""
LARGEST_ELSE = 1e30
"""The same for every other unit, and for numbers without one."""

YEARS = (1960, 2100)
"""First and last year of an epoch."""

# --- messages ---------------------------------------------------------------------------------------------------------

QUOTED_LENGTH = 60
"""Characters of a value that a message repeats."""
MESSAGE_LENGTH = 1_000
"""Characters of a message."""
MESSAGES = 100
"""Messages about one campaign."""
