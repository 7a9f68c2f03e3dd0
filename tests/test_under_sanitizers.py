"""What of the log of a sanitizer counts as a report of the core."""

from __future__ import annotations

import pytest
from under_sanitizers import reports

MEMORY = """=================================================================
==7==ERROR: AddressSanitizer: heap-buffer-overflow on address 0x602
READ of size 8 at 0x602 thread T0
    #0 0x7f in condyn::Rows::held (/site/condyn_pin_native/_core.so+0x1)

0x602 is located 4 bytes after 12-byte region
==7==ABORTING
"""

ARITHMETIC = """/src/core/rows.cpp:7:9: runtime error: signed integer overflow: 2147483647 + 3
    #0 0x7f in condyn::Rows::held (/site/condyn_pin_native/_core.so+0x1)
/src/other.cpp:1:1: runtime error: division by zero
    #0 0x7f in other (/site/another.so+0x1)
"""

RACE = """==================
WARNING: ThreadSanitizer: data race (pid=7)
  Write of size 8 at 0x7b by thread T2:
    #0 condyn::share (/site/condyn_pin_native/_core.so+0x1)
==================
==================
WARNING: ThreadSanitizer: data race (pid=7)
  Write of size 8 at 0x7b by thread T3:
    #0 blas_thread_server (/site/numpy.libs/libopenblas.so+0x1)
==================
"""


@pytest.mark.parametrize(
    ("log", "first"),
    [
        (MEMORY, "==7==ERROR: AddressSanitizer: heap-buffer-overflow"),
        (ARITHMETIC, "/src/core/rows.cpp:7:9: runtime error: signed integer overflow"),
        (RACE, "WARNING: ThreadSanitizer: data race"),
    ],
)
def test_a_report_counts_where_the_core_is_in_its_stack(log, first):
    (report,) = reports(log)
    assert report.startswith(first)
    assert not list(reports(log.replace("condyn_pin_native", "another")))
