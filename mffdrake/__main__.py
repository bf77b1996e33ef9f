"""``python -m mffdrake``: the command line."""

import sys

from mffdrake.experiment.commands.main import main

if __name__ == "__main__":
    sys.exit(main())
