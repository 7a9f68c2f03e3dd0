"""Whole-body control beside tsid and placo: one robot, one wish, one clock."""
