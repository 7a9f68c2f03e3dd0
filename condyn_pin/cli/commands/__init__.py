"""The commands of `condyn`, one file a panel of ``condyn --help``.

1. A command is a function of its name in the file of its panel, and stands in the file's
   ``COMMANDS``; typer reads its signature.
2. The library is imported in the function: ``condyn doctor`` must run where Pinocchio does not
   import, and ``condyn --help`` at once.
3. `arguments` has the arguments that commands share, `words` what they mean, `output` the console,
   what Ctrl-C keeps, and the checks of files that are to be written. What only fails at the end of
   a run is refused before it.
4. Exit code 0 is an answer, 1 an answer that is not ok, 2 a question that cannot be answered, 3 a
   defect of ours, 130 an interrupt. What is raised becomes one line; ``--debug`` shows where.
5. What prints an answer takes ``--json`` (`arguments.AsJson`, `output.print_json`): then there is
   json on stdout and nothing else. What loads a robot takes ``--variant`` (`arguments.Variant`).
"""

from condyn_pin.cli.commands import look, measure, simulate, solve

# Panels of the help in its order, and their commands.
PANELS = {
    "Look": look.COMMANDS,
    "Solve": solve.COMMANDS,
    "Simulate": simulate.COMMANDS,
    "Measure": measure.COMMANDS,
}
