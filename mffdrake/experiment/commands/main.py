"""The command line: ``mffdrake run``, ``compare``, ``track`` and the others.

What a command needs is imported when it is called: the help comes at once. A command is a function
of the parsed options (some also of the scenario and the folder for results, see `_WithScenario`)
that returns the exit status: 0; 1 when runs failed; 2 where the target left the arm's reach; 130
after an interrupt. On bad input it raises an `InputError` or an OSError, most of it before any long
work.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import logging
import os
import signal
import sys
from collections.abc import Callable, Sequence
from importlib import import_module

from mffdrake.experiment.commands.options.parser import MakeParser
from mffdrake.experiment.runs.executors.executors import WorkerDiedError
from mffdrake.experiment.runs.executors.local_processes import PrepareWorkers

__all__ = ["main"]


_LONG_PATH = 300  # characters
_COMMANDS = {
    "run": "run.RunOne", "servo": "run.RunServo", "record": "run.RunRecord",
    "compare": "many.RunCompare", "sweep": "many.RunSweep", "reproduce": "many.RunReproduce",
    "track": "track.RunTrack", "colors": "target.RunColors", "target": "target.RunTarget",
    "calibrate": "calibrate.RunCalibrate",
}  # fmt: skip
_OF_A_SCENARIO = ("run", "servo", "record", "compare")


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command line.

    Args:
        arguments: Without the program's name; the process's own by default.

    Returns:
        The exit status: 0, 1 when runs of a sweep or a reproduction failed or something needed is
        missing (doctor), 2 after a message on bad input, or 130 after an interrupt (143 after
        SIGTERM, 129 after SIGHUP).
    """
    # Loading takes a moment. An interrupt in the midst of that would come out as an import error;
    # so it ends the process as if there was none.
    on_interrupt = signal.getsignal(signal.SIGINT)
    if on_interrupt is not signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    try:
        options = _Parse(arguments)
        # What the others import may be what is broken.
        command = None if options.command == "doctor" else _Load(options)
    finally:
        signal.signal(signal.SIGINT, on_interrupt)
    if command is None:
        return _PrintDiagnosis()
    from mffdrake.experiment.interrupts import SignalsInterrupt

    with SignalsInterrupt() as received:
        return _Call(command, options, received)


def _Parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = MakeParser()
    if "_ARGCOMPLETE" in os.environ:  # A shell asks how a line may go on.
        import argcomplete

        argcomplete.autocomplete(parser)
    return parser.parse_args(arguments)


def _Load(options: argparse.Namespace) -> Callable[[argparse.Namespace], int]:
    """What a command does, with all that it imports."""
    logging.basicConfig(format="mffdrake: %(levelname)s: %(message)s", level=logging.WARNING)
    if _NeedsWorkers(options):  # They load in the background what this process loads, too.
        PrepareWorkers()
    command = _Find(options.command)
    import_module("mffdrake.experiment.commands.options.arguments")  # It is needed below.
    for name in ("mffdrake", "drake"):  # Drake sets its level when it is imported.
        logging.getLogger(name).setLevel(
            logging.INFO if getattr(options, "verbose", False) else logging.WARNING
        )
    return command


def _Call(
    command: Callable[[argparse.Namespace], int], options: argparse.Namespace, received: list[int]
) -> int:
    """Calls a command, and tells what is wrong in a line; returns the exit status."""
    from mffdrake.experiment.commands.options.arguments import CheckFiles
    from mffdrake.experiment.interrupts import Interrupted
    from mffdrake.recognition.parameters import InputError, shorten

    try:
        CheckFiles(options)
        return command(options)
    except OSError as error:
        name = str(error.filename or "")
        if len(name) > _LONG_PATH:
            name = shorten(name)
        message = f"cannot use {name}: {error.strerror}" if name else f"{error.strerror or error}"
    except (InputError, WorkerDiedError) as error:
        message = str(error)
    except KeyboardInterrupt as error:
        received.append(getattr(error, "number", signal.SIGINT))
    except Exception:  # what C code or a library makes of an interrupt
        if not received:
            raise
    if received:  # Whatever it led to.
        end = Interrupted(received[0])
        with contextlib.suppress(OSError):  # The terminal may be gone.
            print(f"mffdrake: {end}", file=sys.stderr)
        return end.status
    print(f"mffdrake: error: {' '.join(message.split())}", file=sys.stderr)
    return 2


def _Find(name: str) -> Callable[[argparse.Namespace], int]:
    """What a command does."""
    if name in ("defaults", "schema"):
        return _PrintDocs
    module, _, function = _COMMANDS[name].partition(".")
    command = getattr(import_module(f"mffdrake.experiment.commands.{module}"), function)
    return _WithScenario(command) if name in _OF_A_SCENARIO else command


def _PrintDocs(options: argparse.Namespace) -> int:
    from mffdrake.experiment.scenario.scenario import Scenario
    from mffdrake.recognition.parameters.documentation import commented_yaml, json_schema

    if options.command == "schema":
        print(json.dumps(json_schema(Scenario), indent=2))
    else:
        print(commented_yaml(Scenario()), end="")
    return 0


def _PrintDiagnosis() -> int:
    from mffdrake.experiment.doctor import Diagnose, Report

    findings = Diagnose()
    print(Report(findings))
    return int(any(finding.mark == "BAD" for finding in findings))


def _WithScenario(command: Callable[..., int]) -> Callable[[argparse.Namespace], int]:
    """A command that is called with the options' scenario and output folder."""
    from mffdrake.experiment.commands.options.arguments import ReadScenario
    from mffdrake.recognition.recordings.files import MakeOutputFolder

    def Call(options: argparse.Namespace) -> int:
        scenario = ReadScenario(options)
        return command(options, scenario, MakeOutputFolder(options.out))

    return Call


def _NeedsWorkers(options: argparse.Namespace) -> bool:
    if options.command not in ("compare", "sweep", "reproduce") or options.scheduler:
        return False
    return options.command in ("sweep", "reproduce") or (options.workers or 1) > 1


if __name__ == "__main__":
    sys.exit(main())
