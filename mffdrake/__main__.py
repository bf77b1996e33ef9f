"""``python -m mffdrake``: the command line."""

import signal
import sys

if __name__ == "__main__":
    # Ctrl-C while the rest loads, too, ends the process without a word; see `main`.
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    from mffdrake.experiment.commands.main import main

    sys.exit(main())
