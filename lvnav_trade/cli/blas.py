"""Linear algebra in one thread, before numpy is imported: set by the import of this module.

The matrices of a report are small, so that threads wait for each other longer than they compute: on two processors the
report of the demo takes three times the processor time with two threads. Cases and runs are spread over processes.
"""

import os

# Those that a user has set stay as they are; worker processes inherit them.
for _name in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
