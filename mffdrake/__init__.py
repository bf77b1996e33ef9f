"""Pose recognition by a moving stereo camera, with motion feedforward, as Drake systems.

The public names of the three rooms are here: `mffdrake.recognition` (no simulator),
`mffdrake.systems` (Drake systems) and `mffdrake.experiment` (scenarios, simulations, results).
`__init__.pyi` is the one list of them, for editors, type checkers and this file alike. They load
when they are first used, so importing the package takes no time.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
