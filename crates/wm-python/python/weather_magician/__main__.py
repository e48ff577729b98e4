"""The program: ``python -m weather_magician render garden.ply --weather fog``."""

import sys

from weather_magician._native import run_program


def main() -> None:
    """Runs the program with the arguments of the command line."""
    sys.exit(run_program(sys.argv))


if __name__ == "__main__":
    main()
