"""Largest sizes of inputs. Larger inputs are refused in one line before they cost time or memory."""

from types import MappingProxyType

# --- YAML files: campaigns, cards, studies ----------------------------------------------------------------------------

YAML_BYTES = 2**20  # size of a file of settings
# Words, lists and mappings of a file of settings, with every repetition by an alias
YAML_NODES = 60_000
YAML_DEPTH = 30  # lists and mappings within each other
YAML_ALIASES = 1_000  # aliases in a file of settings
WORD_LENGTH = 100_000  # characters of a text in a file of settings
LIST_LENGTH = 10_000  # items of any list of settings

# --- data files: trajectories, recordings, almanacs -------------------------------------------------------------------

DATA_BYTES = 2**28  # size of a file of data, unpacked
DATA_ROWS = 1_000_000  # rows of a file of data
FIELD_LENGTH = 1_000  # characters of a field of a file of data

# --- campaigns --------------------------------------------------------------------------------------------------------

AXES = 20  # axes of a campaign
CASES = 500  # cases of a campaign that stores each of them whole
DESIGNS = 100_000  # cases of a campaign that stores metrics alone
RUNS = 1_000_000  # runs of a case
SPOT_CHECK = 32  # fewest runs of a spot check of linear covariance
FINEST_HISTORY = 1e-3  # s between the times of a stored history: few IMUs sample faster
STREAM = 86_400.0  # s of a data stream of an IMU
FAULTS = 100  # faults of a case
STATEMENTS = 1_000  # requirements, references, orderings or statements on innovations of a campaign

# --- quantities -------------------------------------------------------------------------------------------------------

QUANTITY_LENGTH = 80  # characters of a quantity
EXPONENT = 9.0  # exponent of a unit
SMALLEST = 1e-60  # smallest absolute value of a quantity that is not zero, in SI; smaller numbers are typing errors
# Largest absolute value by SI unit; larger numbers are typing errors
LARGEST = MappingProxyType(
    {"m": 1e12, "s": 1e18, "rad": 1e6, "m/s": 3e8, "rad/s": 1e6, "m/s**2": 1e9, "Hz": 1e12, "kg": 1e12, "K": 1e6}
    | {"dimensionless": 1e6}
    | dict.fromkeys(("dB", "dB-Hz", "dBi", "dBW"), 1e3)
)
LARGEST_ELSE = 1e30  # the same for every other unit, and for numbers without one

YEARS = (1960, 2100)  # first and last year of an epoch

# --- messages ---------------------------------------------------------------------------------------------------------

QUOTED_LENGTH = 60  # characters of a value that a message repeats
MESSAGE_LENGTH = 1_000  # characters of a message
MESSAGES = 100  # messages about one campaign
