"""Makes sure that rendering can work, before Drake renders for the first time.

Without a graphics driver, the first render of `RenderEngineVtk` is a segmentation fault, which no
Python code can catch: it kills pytest and notebook kernels. So whatever adds a render engine calls
`RequireGraphics` first, which tries the driver in a process of its own.
"""

import functools
import json
import subprocess
import sys
from pathlib import Path

from mffdrake.recognition.parameters import InputError

__all__ = ["FindGraphicsProblem", "GraphicsUnavailableError", "RequireGraphics"]

_PROBE = Path(__file__).with_name("graphics_probe.py")
_PROBE_TIMEOUT = 30.0  # s; the probe takes about 0.1 s, the first time on a cold disk about 1 s
_REMEDY = (
    "on Debian or Ubuntu, run: sudo apt-get install libglib2.0-0 libegl1 libgl1-mesa-dri"
    " (elsewhere: GLib, libEGL and Mesa's drivers)"
)


class GraphicsUnavailableError(InputError, RuntimeError):
    """This machine cannot render; the message says what is missing and what helps.

    Example:
        >>> try:
        ...     RequireGraphics()
        ... except GraphicsUnavailableError:
        ...     renderer = "flat"  # It needs no driver.
        ... else:
        ...     renderer = "vtk"
    """


@functools.cache  # an error is not cached: the next call looks again
def RequireGraphics() -> None:
    """Checks that this machine can render, with or without a display.

    The first successful call takes about 0.1 s, later ones nothing. On macOS there is nothing to
    check, for VTK draws through Cocoa there.

    Raises:
        GraphicsUnavailableError: When a render would fail or crash the process.

    Example:
        >>> from mffdrake.systems.rendering.graphics import RequireGraphics
        >>> RequireGraphics()
    """
    if sys.platform == "darwin":
        return
    problem = FindGraphicsProblem(_PROBE)
    if problem is not None:
        raise GraphicsUnavailableError(f"cannot render: {problem}; {_REMEDY}")


def FindGraphicsProblem(probe: Path) -> str | None:
    """Runs the probe in a process of its own.

    Args:
        probe: The probe's script.

    Returns:
        What is wrong, or None when rendering works.
    """
    # The environment is inherited, as it steers which driver is found. -I and -S only keep
    # Python's own start short and clean.
    command = [sys.executable, "-I", "-S", str(probe)]
    try:
        finished = subprocess.run(
            command, stdin=subprocess.DEVNULL, capture_output=True, timeout=_PROBE_TIMEOUT
        )
    except subprocess.TimeoutExpired:
        return f"the graphics driver does not answer within {_PROBE_TIMEOUT:.0f} s"
    try:
        answer = json.loads(finished.stdout)
        status, detail = str(answer["status"]), str(answer["detail"])
    except (ValueError, KeyError, TypeError):
        return f"the graphics driver crashes (exit status {finished.returncode})"
    return None if status == "works" else detail
