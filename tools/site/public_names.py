"""The package's public names, as its stubs list them."""

import ast
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]

INDEX = ("mffdrake/recognition/__init__.pyi", "mffdrake/__init__.pyi")


def public_names() -> dict[str, str]:
    """Name -> where it is defined, such as ``mffdrake.systems.timing.Timing``."""
    names: dict[str, str] = {}
    for stub in INDEX:
        package = stub.removesuffix("/__init__.pyi").replace("/", ".")
        for node in ast.parse((ROOT / stub).read_text(encoding="utf-8")).body:
            if isinstance(node, ast.ImportFrom):
                for alias in node.names:
                    names.setdefault(alias.name, f"{package}.{node.module}.{alias.name}")
    return names


def by_room() -> dict[str, list[str]]:
    """Sub-room, such as ``systems/vision`` -> where its public names are defined."""
    rooms: dict[str, list[str]] = {}
    for where in sorted(public_names().values()):
        room, *inner = where.split(".")[1:-1]
        rooms.setdefault(f"{room}/{inner[0]}", []).append(where)
    return rooms
