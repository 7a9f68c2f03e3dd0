"""Run the commands of the laboratory from a checkout: python benchmarks/lab stress."""

import sys
from pathlib import Path

# Before numpy is imported: it decides how many threads there are.
from condyn_pin.cli.main import run


def main() -> None:
    """Put `benchmarks` on the path, for the processes of workers too, and run a command."""
    here = Path(__file__).resolve().parent
    sys.path = [str(here.parent), *(path for path in sys.path if Path(path).resolve() != here)]
    from lab.cli import app

    run(app, sys.argv[1:], "python benchmarks/lab")


if __name__ == "__main__":
    main()
