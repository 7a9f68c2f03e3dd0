"""The command line: `main` runs it, `commands/` has one file a command.

It may import every room, and none imports it. The library is imported in the functions that use
it: `condyn doctor` must run where Pinocchio does not import, and `condyn --help` at once.
"""
