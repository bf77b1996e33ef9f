# PYTHON_ARGCOMPLETE_OK: shells that complete every program ask this one, too.
"""The command line's start: ``python -m mffdrake``, and the installed program ``mffdrake``."""

import signal
import sys

__all__ = ["run"]


def run() -> int:
    """Runs the command line; Ctrl-C while it still loads ends the process without a word.

    Returns:
        The exit status, see `mffdrake.experiment.commands.main.main`.
    """
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    from mffdrake.experiment.commands.main import main

    return main()


if __name__ == "__main__":
    sys.exit(run())
