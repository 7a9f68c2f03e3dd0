"""The command line, as ``python -m condyn_pin``."""

from condyn_pin.cli import main

if __name__ == "__main__":
    main()
