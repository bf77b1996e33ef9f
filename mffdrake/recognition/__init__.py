"""Pose recognition in pure NumPy and compiled kernels: usable on the images of any rig.

Nothing here imports pydrake. `__init__.pyi` lists the public names and where they are; they load
when they are first used.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
