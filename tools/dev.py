"""Sets this checkout up and runs it: python3 tools/dev.py TARGET [-- ARGUMENTS].

Without a target, or with "help", it tells what the targets do.

The first run installs the missing system packages (with apt, as root or with password-less sudo;
otherwise it prints the command and stops), makes .venv and installs the project in it. Later runs
do so again only when pyproject.toml, the Python version or the extras change.

Standard library only. The syntax stays that of Python 3.6, so that an old Python can say that it
is too old and hand over to a newer one.
"""

import contextlib
import hashlib
import importlib
import importlib.util
import json
import os
import shutil
import subprocess
import sys

# What each target runs, as arguments of .venv/bin/python, one after the other.
DIAGRAM = ["--workers", "2", "--graphviz", "out/diagram.svg"]
DEMO = [["-m", "mffdrake", "reproduce", "--short", *DIAGRAM]]
QUICK_DEMO = [["-m", "mffdrake", "compare", "--renderer", "flat", *DIAGRAM]]
BENCH = [["benchmarks", "performance"]]
TEST = [["-m", "pytest", "-n", "logical", "--dist", "worksteal"]]
LINT = [["-m", "ruff", "check"], ["-m", "ruff", "format", "--check"], ["-m", "mypy"]]
LAB = [["-m", "jupyterlab", "notebooks"]]
DOCS = [["-m", "mkdocs", "build", "--strict"]]
TEST_ALL = [["tools/test_all.py"]]
FUZZ = [["tools/fuzz.py"]]

# Target: what it does, its commands, the project's extras they need, and whether they draw.
TARGETS = {
    "demo": ("the paper's figures and table from one seed: out/report.html", DEMO, {"dev"}, True),
    "quick-demo": ("one run with motion feedforward and one without", QUICK_DEMO, {"dev"}, True),
    "test": ("all tests; ARGS='-k tracker' for some", TEST, {"dev"}, True),
    "test-all": (
        "all tests on each Python from 3.11 to 3.13 that is there",
        TEST_ALL,
        {"dev"},
        True,
    ),
    "fuzz": ("random bad input, as much as wanted; ARGS='--cases 100000'", FUZZ, {"dev"}, False),
    "lint": ("style, format and types", LINT, {"dev"}, False),
    "bench": ("times everything: docs/studies/performance.md (ten minutes)", BENCH, {"dev"}, True),
    "docs": ("the documentation: out/site/index.html", DOCS, {"docs"}, False),
    "lab": ("the notebooks, in JupyterLab", LAB, {"dev", "notebooks"}, True),
}

OLDEST_PYTHON = (3, 11)
NEWER_PYTHONS = ("python3.13", "python3.12", "python3.11")
VERSION = f"{sys.version_info[0]}.{sys.version_info[1]}"
GRAPHICS_PACKAGES = ["libglib2.0-0", "libegl1", "libgl1-mesa-dri"]

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
VENV = os.path.join(ROOT, os.environ.get("DEV_VENV", ".venv"))  # test_all.py has one a Python
PROBE = os.path.join(ROOT, "mffdrake", "systems", "rendering", "graphics_probe.py")


def main(arguments: list) -> int:
    """Sets up what the target needs, runs it and returns the exit status."""
    if os.name == "nt":
        return fail("Drake has no Windows build; use WSL 2 (Windows Subsystem for Linux)")
    if sys.version_info < OLDEST_PYTHON:
        return hand_over_to_newer_python(arguments)
    target, extra = (arguments[0] if arguments else "help"), arguments[1:]
    if target == "help":
        print(help_text())
        return 0
    if target not in TARGETS:
        names = "|".join(["help", *TARGETS])
        return fail(f"unknown target {target!r}; use: dev.py {names} [-- ARGUMENTS]", status=2)
    _, commands, extras, draws = TARGETS[target]
    if extra[:1] == ["--"]:
        extra = extra[1:]
    if extra and len(commands) > 1:
        return fail(f"{target} takes no arguments, got: {' '.join(extra)}", status=2)

    os.chdir(ROOT)
    # Packages from elsewhere (a sourced ROS sets PYTHONPATH) must not mix with those of .venv.
    os.environ.pop("PYTHONPATH", None)
    os.environ.pop("PYTHONHOME", None)
    os.environ.pop("DEV_VENV", None)  # The tests run dev.py, too.
    with one_setup_at_a_time():
        set_up_system(draws)
        set_up_venv(extras)
    for command in commands[:-1]:
        status = run(command)
        if status:
            return status
    return run(commands[-1] + extra)


def help_text() -> str:
    """Returns a line for each target."""
    targets = [(name, does) for name, (does, _, _, _) in TARGETS.items()]
    return "\n".join(f"make {name:<12}{does}" for name, does in [("help", "this list"), *targets])


# Output and processes.


def say(line: str) -> None:
    """Tells people what is going on; standard output belongs to the command that is run."""
    print(f"dev.py: {line}", file=sys.stderr, flush=True)


def fail(line: str, status: int = 1) -> int:
    say(line)
    return status


def run(command: list) -> int:
    """Runs a command in the virtual environment, and returns its exit status."""
    environment = dict(os.environ, VIRTUAL_ENV=VENV)
    environment["PATH"] = os.path.join(VENV, "bin") + os.pathsep + os.environ.get("PATH", "")
    say(" ".join(["python", *command]))
    process = subprocess.Popen([venv_python(), *command], env=environment)
    try:
        status = process.wait()
    except KeyboardInterrupt:
        # Ctrl-C reached the command as well: let it end in its own way (pytest's summary,
        # Jupyter's question), and end at once at the second one.
        status = process.wait() or 130
    if status < 0:
        status = fail(f"{command[1]} was ended by signal {-status}", status=128 - status)
    return status


def run_quietly(command: list, **variables: str) -> bool:
    """Runs a command that should not speak; shows all it said when it fails."""
    finished = subprocess.run(
        command,
        env=dict(os.environ, **variables),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
    )
    if finished.returncode:
        sys.stderr.write(finished.stdout)
        say(f"failed with exit status {finished.returncode}: {' '.join(command)}")
    return finished.returncode == 0


@contextlib.contextmanager
def one_setup_at_a_time():
    """Lets a second dev.py (make -j, another terminal) wait until the first has set up."""
    import fcntl

    with contextlib.ExitStack() as stack:
        with contextlib.suppress(OSError):  # read-only, or a file system without locks
            lock = stack.enter_context(open(__file__, "r+"))
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                say("waiting for another dev.py to set up")
                fcntl.flock(lock, fcntl.LOCK_EX)
        yield


# Python.


def hand_over_to_newer_python(arguments: list) -> int:
    """Replaces this process by a newer Python on PATH; returns 1 when there is none."""
    for name in NEWER_PYTHONS:
        path = shutil.which(name)
        # A version manager's stand-in is on PATH even when it has no such Python: try it.
        check = f"import sys; sys.exit(sys.version_info < {OLDEST_PYTHON})"
        if path and call_silently([path, "-c", check]):
            os.execv(path, [path, os.path.abspath(__file__)] + arguments)  # noqa: RUF005
    return fail(
        f"needs Python {OLDEST_PYTHON[0]}.{OLDEST_PYTHON[1]} or newer, but {sys.executable} is"
        f" Python {VERSION}, and PATH has none of {', '.join(NEWER_PYTHONS)}; install one, or name"
        " it: make test PYTHON=/path/to/it"
    )


def call_silently(command: list) -> bool:
    with open(os.devnull, "r+") as null:
        return subprocess.call(command, stdin=null, stdout=null, stderr=null) == 0


def base_python() -> str:
    """Returns the interpreter that .venv is made of, also when .venv itself runs this script."""
    return getattr(sys, "_base_executable", None) or sys.executable


# System packages.


def set_up_system(draws: bool) -> None:
    """Installs missing system packages, or stops with the command that would."""
    problems = find_system_problems(draws)
    if not problems:
        return
    packages = [package for _, packages in problems for package in packages]
    say("; ".join(problem for problem, _ in problems))
    prefix = administrator_prefix()
    if shutil.which("apt-get") is None:
        if sys.platform == "darwin":
            raise SystemExit(fail(f"run: brew install {' '.join(packages)}"))
        names = " ".join(packages)
        raise SystemExit(fail(f"install what Debian calls {names}, then run this again"))
    if prefix is None:
        names = " ".join(packages)
        raise SystemExit(fail(f"run: sudo apt-get update && sudo apt-get install -y {names}"))

    say(f"installing system packages with apt-get: {' '.join(packages)}")
    apt_get = [*prefix, "env", "DEBIAN_FRONTEND=noninteractive", "apt-get"]
    apt_get += ["-qq", "-o", "DPkg::Lock::Timeout=120"]
    # A foreign package source that is out of order need not stand in the way of the installation.
    run_quietly([*apt_get, "update"])
    if not run_quietly([*apt_get, "install", "-y", "--no-install-recommends", *packages]):
        raise SystemExit(1)
    importlib.invalidate_caches()
    problems = find_system_problems(draws)
    if problems:
        still = "; ".join(problem for problem, _ in problems)
        raise SystemExit(fail(f"still, with {' '.join(packages)} installed: {still}"))


def find_system_problems(draws: bool) -> list:
    """Returns pairs of (what is wrong, the Debian packages that help)."""
    problems = []
    ensurepip = importlib.util.find_spec("ensurepip")
    if ensurepip is None or ensurepip.origin is None:  # Debian ships it in a package of its own
        problem = f"Python {VERSION} cannot make virtual environments"
        problems.append((problem, [f"python{VERSION}-venv"]))
    if draws:
        graphics = find_graphics_problem()
        if graphics:
            problems.append((f"cannot render: {graphics}", GRAPHICS_PACKAGES))
        if shutil.which("dot") is None:
            problems.append(("Graphviz's dot is missing", ["graphviz"]))
    return problems


def find_graphics_problem() -> str:
    """Runs the probe in a process of its own, as a broken driver may crash it."""
    command = [base_python(), "-I", "-S", PROBE]
    finished = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True)
    if finished.returncode == 0:
        return ""
    try:
        return json.loads(finished.stdout)["detail"]
    except (ValueError, KeyError):
        return f"the graphics driver crashes (exit status {finished.returncode})"


def administrator_prefix() -> "list | None":
    """Returns what makes a command run as root without a question; None when nothing does."""
    if os.geteuid() == 0:
        return []
    if shutil.which("sudo") and call_silently(["sudo", "-n", "true"]):
        return ["sudo", "-n"]
    return None


# The virtual environment.


def set_up_venv(extras: set) -> None:
    """Makes .venv and installs the project in it, when the last time does not serve any more."""
    wanted = describe_setup(extras)
    stamp = read_stamp(VENV)
    works = venv_works(VENV)
    if works and serves(stamp, wanted):
        return

    # Without a stamp, an interrupted installation is done again.
    with contextlib.suppress(FileNotFoundError):
        os.remove(stamp_path(VENV))
    same_place = all(stamp.get(key, wanted[key]) == wanted[key] for key in ("python", "root"))
    if not (works and same_place):
        does = "rebuilding" if os.path.lexists(VENV) else "making"
        say(f"{does} {os.path.basename(VENV)} with Python {VERSION}")
        if not run_quietly([base_python(), "-m", "venv", "--clear", VENV]):
            raise SystemExit(1)
    # An extra that was asked for once stays, or test and lab would install in turns.
    wanted["extras"] = sorted(extras.union(stamp.get("extras", [])))
    project = f".[{','.join(wanted['extras'])}]"
    place = os.path.basename(VENV)
    say(f"installing {project} and what it needs in {place} (up to a few minutes, about 1 GB)")
    pip = [venv_python(), "-m", "pip", "--disable-pip-version-check", "--no-input"]
    if not run_quietly([*pip, "install", "--quiet", "--editable", project]):
        raise SystemExit(1)
    write_stamp(VENV, wanted)


def describe_setup(extras: set, root: str = ROOT) -> dict:
    """Returns all that the contents of .venv depend on."""
    with open(os.path.join(root, "pyproject.toml"), "rb") as file:
        pyproject = hashlib.sha256(file.read()).hexdigest()
    return {"root": root, "python": VERSION, "pyproject": pyproject, "extras": sorted(extras)}


def serves(stamp: dict, wanted: dict) -> bool:
    """Tells whether an installation with this stamp has all that is wanted."""
    same = all(stamp.get(key) == wanted[key] for key in ("root", "python", "pyproject"))
    return same and set(wanted["extras"]) <= set(stamp.get("extras", []))


def stamp_path(venv: str) -> str:
    return os.path.join(venv, "dev-stamp.json")


def read_stamp(venv: str) -> dict:
    try:
        with open(stamp_path(venv)) as file:
            stamp = json.load(file)
    except (OSError, ValueError):
        return {}
    return stamp if isinstance(stamp, dict) else {}


def write_stamp(venv: str, setup: dict) -> None:
    """Writes the stamp in one step, so that there never is half a stamp."""
    path = stamp_path(venv)
    with open(path + ".new", "w") as file:
        json.dump(setup, file, indent=1)
    os.replace(path + ".new", path)


def venv_python() -> str:
    return os.path.join(VENV, "bin", "python")


def venv_works(venv: str) -> bool:
    """Tells whether the environment's Python starts, is of this version and has pip."""
    check = f"import pip, sys; sys.exit(sys.version_info[:2] != {sys.version_info[:2]})"
    try:
        return call_silently([os.path.join(venv, "bin", "python"), "-c", check])
    except OSError:
        return False


if __name__ == "__main__":
    try:
        sys.exit(main(sys.argv[1:]))
    except KeyboardInterrupt:
        sys.exit(fail("interrupted", status=130))
