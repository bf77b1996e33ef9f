"""The command line on a terminal of its own, where a person watches and can type."""

import subprocess
import sys
from pathlib import Path

SCRIPT = [str(Path(sys.executable).parent / "mffdrake")]
TERMINAL = """
import os, pty, sys
sys.exit(os.waitstatus_to_exitcode(pty.spawn(sys.argv[1:])))
"""


def on_terminal(*arguments, cwd, ctrl_c_at=None):
    """Runs the command line on a terminal of its own, 100 columns wide.

    Args:
        ctrl_c_at: Ctrl-C is typed as soon as this text appears; nothing is typed without.

    Returns:
        The exit status and all that appeared.
    """
    in_terminal = ["sh", "-c", 'stty cols 100 rows 30; exec "$0" "$@"', *SCRIPT]
    with subprocess.Popen(
        [sys.executable, "-c", TERMINAL, *in_terminal, *map(str, arguments)],
        cwd=cwd, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
    ) as process:  # fmt: skip
        shown = b""
        while some := process.stdout.read1(4096):
            shown += some
            if ctrl_c_at is not None and ctrl_c_at.encode() in shown:
                process.stdin.write(b"\x03")
                process.stdin.flush()
                ctrl_c_at = None
    assert ctrl_c_at is None, f"{ctrl_c_at!r} never appeared in {shown!r}"
    # Where colorama is installed, numba lets it reset the terminal's colors at the end.
    return process.returncode, shown.decode().replace("\x1b[0m", "")
