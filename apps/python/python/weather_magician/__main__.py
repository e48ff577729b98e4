"""The program: ``python -m weather_magician render garden.ply --weather fog``."""

import signal
import sys

from weather_magician._native import run_program


def main() -> None:
    """Runs the program with the arguments of the command line."""
    # The program stops by itself; Python's handler would raise KeyboardInterrupt after it.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    sys.exit(run_program(sys.argv))


if __name__ == "__main__":
    main()
