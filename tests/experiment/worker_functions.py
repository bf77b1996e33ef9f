"""What the executors' tests run in other processes, which must be able to import it."""

import logging
import os
import signal
import time
from pathlib import Path

DEADLINE = 1800.0  # s; only for what would never end: on a busy machine all takes minutes


def wait_for(condition, what):
    """Polls until a condition holds, and returns its value."""
    end = time.monotonic() + DEADLINE
    while time.monotonic() < end:
        value = condition()
        if value:
            return value
        time.sleep(0.01)
    raise TimeoutError(f"waited in vain for {what}")


def square(x):
    return x * x


def fail_at(x, bad):
    if x == bad:
        raise ValueError(f"{x} is\nbad")
    return x


def process_id(_):
    return os.getpid()


def begin_and_wait(folder, name):
    """Says in a file that it has begun, and goes on when the file "go" is there."""
    beginning = Path(folder) / f"{name}-{os.getpid()}.part"
    beginning.touch()
    beginning.rename(beginning.with_suffix(".begun"))
    wait_for((Path(folder) / "go").exists, "the file go")
    return name


def begun(folder, name):
    """The processes that have begun a run, so far."""
    return sorted(int(p.stem.rpartition("-")[2]) for p in Path(folder).glob(f"{name}-*.begun"))


def die_at(x, bad):
    """Ends like a process that the kernel has killed for lack of memory."""
    if x == bad:
        os.kill(os.getpid(), signal.SIGKILL)
    return x


def environment(name):
    return os.environ.get(name)


def log_level():
    return logging.getLogger("mffdrake").getEffectiveLevel()
