"""What moves in the scene beside the target: in front of it, or in its colors.

A kind of clutter is a class of parameters that makes its own systems. A new one is a file here and
a line in `Clutter`.
"""

from typing import Annotated, TypeAlias

from mffdrake.recognition.parameters import OneOf
from mffdrake.systems.clutter.distractors import Distractors
from mffdrake.systems.clutter.occluder import Occluder
from mffdrake.systems.clutter.scene_clutter import SceneClutter

__all__ = ["Clutter", "Distractors", "Occluder", "SceneClutter"]

Clutter: TypeAlias = Annotated[Occluder | Distractors, OneOf()]
"""A parameter that is one kind of clutter; in YAML a tag or a name such as ``occluder``."""
