"""The package's rooms and their arrows, its public names, and its docstrings' examples."""

import ast
import doctest
import importlib
import inspect
import pkgutil
import re
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import pytest

import mffdrake
import mffdrake.recognition

PACKAGE = Path(mffdrake.__file__).parent
SOURCES = sorted(PACKAGE.rglob("*.py"))
MODULES = [
    info.name
    for info in pkgutil.walk_packages(mffdrake.__path__, "mffdrake.")
    if info.name != "mffdrake.__main__"  # It runs the command line.
]
PRINTING = {
    *(
        f"experiment/commands/{name}.py"
        for name in ("calibrate", "main", "many", "one", "run", "target", "track")
    ),
    "systems/rendering/graphics_probe.py",
}  # fmt: skip


def tree(source):
    return ast.parse(source.read_text(encoding="utf-8"), filename=str(source))


def imported(source):
    """Full names of all that a file imports, at any level of its code and under any condition."""
    package = ["mffdrake", *source.relative_to(PACKAGE).parts[:-1]]
    names = set()
    for node in ast.walk(tree(source)):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            module = ".".join([*base, *([node.module] if node.module else [])])
            names |= {f"{module}.{alias.name}" for alias in node.names}
    return names


def room_imports(room, *forbidden):
    """The imports of a room's files from any of the forbidden packages."""
    return {
        f"{source.relative_to(PACKAGE)}: {name}"
        for source in SOURCES
        if source.relative_to(PACKAGE).parts[0] == room
        for name in imported(source)
        if any(f"{name}.".startswith(f"{package}.") for package in forbidden)
    }


ORDERS = {
    "recognition": [
        "parameters", "poses", "camera", "solid", "visibility", "fitness", "refinement", "genetic",
        "acquisition", "tracking", "recordings", "ros",
    ],
    "systems": [
        "cameras", "view", "rendering", "arms", "clutter", "disturbances", "target_motion",
        "control", "vision",
    ],
    "experiment": ["scenario", "simulation", "runs", "paper", "commands"],
}  # fmt: skip
"""The sub-rooms of a room, each of which imports only from those before it and from itself."""


def run_python(code):
    finished = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    return finished.stdout.split()


# Arrows one way: experiment -> systems -> recognition.


def test_the_imports_that_are_there_are_found():
    """What the checks below rest on."""
    assert "pydrake.math.RigidTransform" in imported(PACKAGE / "systems" / "arms" / "pa10.py")
    assert room_imports("systems", "pydrake")
    assert room_imports("systems", "mffdrake.recognition")
    assert room_imports("experiment", "mffdrake.systems")


def test_no_file_imports_through_the_packages_front_door():
    """Its lazy names would let every arrow through."""
    rooms = {"mffdrake.recognition", "mffdrake.systems", "mffdrake.experiment"}
    for source in SOURCES:
        own = {name for name in imported(source) if name.split(".")[0] == "mffdrake"}
        assert {".".join(name.split(".")[:2]) for name in own} <= rooms, source


def test_recognition_knows_nothing_of_drake_and_of_the_other_rooms():
    forbidden = ("pydrake", "mffdrake.systems", "mffdrake.experiment")
    assert room_imports("recognition", *forbidden) == set()


def test_systems_know_nothing_of_experiments():
    assert room_imports("systems", "mffdrake.experiment", "matplotlib", "tqdm") == set()


@pytest.mark.parametrize("room", ORDERS)
def test_arrows_between_sub_rooms_go_one_way(room):
    """Imports for type checkers count, too; the room's own front door is for those outside."""
    order, against = ORDERS[room], []
    folders = {path.parent.name for path in (PACKAGE / room).glob("*/__init__.py")}
    assert folders == set(order)
    for source in SOURCES:
        top, *inner = source.relative_to(PACKAGE).parts
        if top != room or len(inner) < 2:
            continue
        allowed = order[: order.index(inner[0]) + 1]
        own = [
            name.split(".")[2:] for name in imported(source) if name.startswith(f"mffdrake.{room}.")
        ]
        # Modules beside the sub-rooms serve all of them.
        against += [(source.name, n) for n in own if n[0] in order and n[0] not in allowed]
    assert against == []


def test_files_and_folders_stay_readable_in_one_sitting():
    root = PACKAGE.parent
    for source in [*SOURCES, *(root / "benchmarks").rglob("*.py"), *(root / "tools").rglob("*.py")]:
        assert len(source.read_text(encoding="utf-8").splitlines()) <= 350, source
        beside = [path for path in source.parent.iterdir() if path.suffix in (".py", ".yaml")]
        assert len(beside) <= 8, source.parent


def test_nothing_imports_all_of_drake():
    for source in SOURCES:
        assert not {n for n in imported(source) if f"{n}.".startswith("pydrake.all.")}, source


@pytest.mark.parametrize(
    ("statement", "absent"),
    [
        ("import mffdrake", "numpy pydrake numba matplotlib cv2 trimesh"),
        ("import mffdrake.recognition", "numpy pydrake numba matplotlib cv2 trimesh"),
        # All of its public names, too: what compiles loads where it is first called.
        ("from mffdrake.recognition import *", "pydrake numba matplotlib trimesh"),
    ],
)
def test_importing_loads_no_slow_library(statement, absent):
    loaded = run_python(f"import sys\n{statement}\nprint(*sys.modules)")
    assert "mffdrake" in loaded
    assert set(absent.split()) & set(loaded) == set()


def test_only_the_command_line_prints():
    printing = {
        source.relative_to(PACKAGE).as_posix()
        for source in SOURCES
        for node in ast.walk(tree(source))
        if isinstance(node, ast.Call)
        and isinstance(node.func, ast.Name)
        and node.func.id == "print"
    }
    assert printing <= PRINTING
    assert "experiment/commands/main.py" in printing


# Public names.


def stub_names(package):
    """What a package's `__init__.pyi` says: public name -> the module it comes from."""
    names = {}
    for node in tree(Path(package.__file__).with_suffix(".pyi")).body:
        for alias in node.names:
            # Without "as", a type checker takes a stub's import for the stub's own use.
            assert alias.asname == alias.name, f"{alias.name} is not re-exported"
            assert alias.name not in names, f"{alias.name} stands there twice"
            names[alias.name] = f"{package.__name__}.{node.module}"
    return names


def attribute_docstring(name, module):
    """The string below a name's assignment in its module."""
    body = tree(Path(importlib.import_module(module).__file__)).body
    for node, below in pairwise(body):
        targets = getattr(node, "targets", [getattr(node, "target", None)])
        assigned = {part.id for t in targets if t for part in ast.walk(t) if hasattr(part, "id")}
        documents = isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant)
        if name in assigned and documents:
            return below.value.value
    return None


PUBLIC = [
    *((mffdrake, name) for name in mffdrake.__all__),
    *((mffdrake.recognition, name) for name in mffdrake.recognition.__all__),
]


@pytest.mark.parametrize(
    ("package", "name"), PUBLIC, ids=lambda value: getattr(value, "__name__", value)
)
def test_every_public_name_resolves_and_is_documented(package, name):
    value = getattr(package, name)
    home = stub_names(package)[name]
    assert value is getattr(importlib.import_module(home), name)
    assert name in getattr(importlib.import_module(home), "__all__", [name])
    assert name in dir(package)
    if callable(value):
        doc = vars(value).get("__doc__") if inspect.isclass(value) else value.__doc__
        # A dataclass without a docstring gets its signature for one.
        assert doc and not doc.startswith(f"{name}(")
    elif type(value).__module__.split(".")[0] != "typing":  # A union of documented classes.
        assert attribute_docstring(name, home)


@pytest.mark.parametrize("package", [mffdrake, mffdrake.recognition])
def test_only_public_names_are_there(package):
    assert len(package.__all__) == len(stub_names(package))
    assert sorted(package.__all__) == package.__all__
    with pytest.raises(AttributeError, match="NoSuchName"):
        _ = package.NoSuchName
    with pytest.raises(ImportError, match="NoSuchName"):
        exec(f"from {package.__name__} import NoSuchName")


@pytest.mark.parametrize("name", MODULES)
def test_every_module_says_what_it_is_for_and_lists_only_what_it_has(name):
    module = importlib.import_module(name)
    assert module.__doc__
    for public in getattr(module, "__all__", []):
        assert hasattr(module, public), public


# Private names stay in the package: what tests and benchmarks need is public.

USERS = [
    source
    for folder in ("tests", "benchmarks", "examples")
    for source in sorted((Path(__file__).parents[1] / folder).rglob("*.py"))
]
# Those of named tuples, and Meshcat's for tests
OTHERS = re.compile(r"_replace|_GetPacked\w+|_InjectWebsocketMessage")


def is_private(name):
    return any(re.match("_(?!_)", part) for part in name.split("."))


def private_names(code):
    """What code takes from elsewhere that begins with an underscore."""
    names = set()
    for node in ast.walk(code):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names |= {f"{node.module}.{alias.name}" for alias in node.names}
        elif isinstance(node, ast.Constant) and re.match(r"mffdrake\.[\w.]+$", str(node.value)):
            names.add(node.value)  # as pytest.importorskip and monkeypatch.setattr take it
        elif isinstance(node, ast.Attribute) and not OTHERS.fullmatch(node.attr):
            own = ast.unparse(node.value) in ("self", "cls")
            names |= {ast.unparse(node)} if is_private(node.attr) and not own else set()
    return {name for name in names if is_private(name)}


@pytest.mark.parametrize(
    ("code", "found"),
    [
        ("import mffdrake.systems._timing", "mffdrake.systems._timing"),
        ("from mffdrake.systems._timing import Timing", "mffdrake.systems._timing.Timing"),
        ("from mffdrake.systems.timing import _Ticks", "mffdrake.systems.timing._Ticks"),
        ('pytest.importorskip("mffdrake.systems._timing")', "mffdrake.systems._timing"),
        ("timing = mff.Timing()._ticks", "mff.Timing()._ticks"),
        ("from __future__ import annotations; self._own = numbers._replace(x=1).__doc__", None),
    ],
)
def test_private_names_are_found(code, found):
    assert private_names(ast.parse(code)) == ({found} if found else set())


def test_tests_benchmarks_and_examples_use_public_names_only():
    used = {source: private_names(tree(source)) for source in USERS}
    own = Path(__file__)  # Its examples above are meant.
    assert {source: names for source, names in used.items() if names and source != own} == {}


# Examples.


@pytest.mark.parametrize("name", ["mffdrake", *MODULES])
def test_the_examples_in_the_docstrings_are_right(name, capsys):
    result = doctest.testmod(importlib.import_module(name))
    assert result.failed == 0, capsys.readouterr().out


@pytest.mark.parametrize(
    ("package", "name"), PUBLIC, ids=lambda value: getattr(value, "__name__", value)
)
def test_every_public_class_and_function_has_an_example(package, name):
    """Exceptions and protocols, too; numbers, tables and unions of documented classes need none.

    Those of a class's methods do not stand for its own.
    """
    value = getattr(package, name)
    if inspect.isclass(value) or inspect.isroutine(value):
        doc = inspect.cleandoc(inspect.unwrap(value).__doc__)
        section = doc.partition("\nExample:\n")[2]
        assert doctest.DocTestParser().get_examples(section), f"{name} has no section Example:"
