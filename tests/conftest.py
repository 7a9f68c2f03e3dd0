"""One thread for the linear algebra, set before numpy is imported: answers to the bit need it."""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
