"""What of a log of valgrind counts as a report of the core."""

from __future__ import annotations

from under_valgrind import reports

LOG = """==7== Memcheck, a memory error detector
==7==
==7== Invalid read of size 8
==7==    at 0x1: condyn::Rows::held (in /site/condyn_pin_native/_core.so)
==7==    by 0x2: PyObject_Call (in /usr/bin/python3.11)
printed by a test
==7==
==7== Conditional jump or move depends on uninitialised value(s)
==7==    at 0x3: dlaswp_plus (in /site/numpy.libs/libopenblas.so)
==7==
==7== ERROR SUMMARY: 2 errors from 2 contexts
"""


def test_a_report_counts_where_the_core_is_in_its_stack():
    (report,) = reports(LOG)
    assert report.startswith("Invalid read of size 8\n")
    assert report.count("\n") == 2
    assert not list(reports(LOG.replace("condyn_pin_native", "another")))


def test_what_the_c_library_does_inside_a_wait_is_no_report():
    wait = """==7== pthread_cond_{signal,broadcast}: associated lock is not held by calling thread
==7==    at 0x1: ??? (in /usr/libexec/valgrind/vgpreload_helgrind-amd64-linux.so)
==7==    by 0x2: __pthread_cond_wait_common (pthread_cond_wait.c:516)
==7==    by 0x3: condyn::share (in /site/condyn_pin_native/_core.so)
==7==
"""
    assert not list(reports(wait))
    (report,) = reports(wait.replace("__pthread_cond_wait_common", "condyn::take"))
    assert "lock is not held" in report
