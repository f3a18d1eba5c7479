"""Linear algebra in one thread: set by the import of this module, which must precede that of numpy.

The matrices of a report are small, so that threads wait for each other longer than they compute: on two processors the
report of the demo takes three times the processor time with two threads. Cases and runs are spread over processes.
"""

import os

# Values that the user has set remain; worker processes inherit them.
for _name in ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
