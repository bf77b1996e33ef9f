"""Where the package's models (URDF, SDF, OBJ) are, and how a Drake parser finds them."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pydrake.multibody.parsing import Parser

__all__ = ["ConfigureParser", "DescribeMissing", "FindModelsPath"]

_logger = logging.getLogger(__name__)

_PACKAGE_NAME = "mffdrake"
_PACKAGE_XML = "package.xml"


def FindModelsPath() -> Path:
    """Finds the directory with the package's models.

    A wheel holds the models inside the package, in ``mffdrake/models/``; a checkout holds them
    beside it, in the top-level ``models/``.

    Returns:
        The absolute path of the directory that holds ``package.xml``, ``pa10.urdf`` and
        ``target_box.sdf``.

    Raises:
        FileNotFoundError: If neither place has a ``package.xml``; the message names both.

    Example:
        >>> from mffdrake.systems.arms.models import FindModelsPath
        >>> (FindModelsPath() / "pa10.urdf").is_file()
        True
    """
    package_path = Path(__file__).resolve().parents[2]
    candidates = (package_path / "models", package_path.parent / "models")
    for candidate in candidates:
        if (candidate / _PACKAGE_XML).is_file():
            return candidate
    looked_in = " and ".join(str(candidate) for candidate in candidates)
    raise FileNotFoundError(
        f"mffdrake's models are missing: no {_PACKAGE_XML} in {looked_in}. "
        "Install mffdrake again from a wheel, or use a complete checkout."
    )


def DescribeMissing(path: str) -> str:
    """Says that a file of a scenario is not there, and where it was looked for.

    Example:
        >>> DescribeMissing("/none.sdf")
        "there is no file '/none.sdf'"
    """
    text = f"there is no file '{path}'"
    if Path(path).expanduser().is_absolute():
        return text
    return (
        f"{text} in the current folder, {Path.cwd()}, nor beside the scenario file, if one names it"
    )


def ConfigureParser(parser: Parser) -> None:
    """Lets a Drake parser resolve ``package://mffdrake/`` URIs.

    Calling it again with the same parser changes nothing. If the parser already knows a package
    named ``mffdrake`` somewhere else, that one stays in effect, so that you can override the models
    by adding your own directory to ``parser.package_map()`` first.

    Args:
        parser: The parser to configure.

    Raises:
        FileNotFoundError: If the models cannot be found; see :func:`FindModelsPath`.

    Example:
        >>> from pydrake.multibody.parsing import Parser
        >>> from pydrake.multibody.plant import MultibodyPlant
        >>> from mffdrake.systems.arms.models import ConfigureParser
        >>> plant = MultibodyPlant(time_step=0.0)
        >>> parser = Parser(plant)
        >>> ConfigureParser(parser)
        >>> (target,) = parser.AddModels(url="package://mffdrake/target_box.sdf")
        >>> plant.GetModelInstanceName(target)
        'target_box'
    """
    package_map = parser.package_map()
    if package_map.Contains(_PACKAGE_NAME):
        _logger.debug(
            "package://%s/ is already known: %s", _PACKAGE_NAME, package_map.GetPath(_PACKAGE_NAME)
        )
        return
    package_map.AddPackageXml(filename=FindModelsPath() / _PACKAGE_XML)
