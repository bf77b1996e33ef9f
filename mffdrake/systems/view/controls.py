"""Meshcat's buttons and sliders: pause, step, speed and reset, and gauges of the recognition."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

from numpy.typing import ArrayLike
from pydrake.geometry import Meshcat

from mffdrake.recognition import TrackingState
from mffdrake.systems.view.pose_view import SetView

__all__ = ["LiveControls"]

_PAUSE, _STEP, _RESET = "pause / go on", "step", "reset"
_SPEED = "speed (0 max)"  # times real time; a page shows no longer names
_FITNESS, _CONFIDENCE = "= fitness", "= confidence"
_POLL = 0.01  # Wall time between two looks at the buttons [s].


class LiveControls:
    """Buttons and sliders on a Meshcat page, for whom is looking on.

    What they are set to stands in Meshcat itself. Sliders that can only be read show fitness and
    confidence, and the name of the last button tells the state.

    Args:
        meshcat: The page.
        can_reset: Whether there is a button that begins anew.

    Example:
        >>> controls = LiveControls(Meshcat())
        >>> controls.Wait(0.033)  # not paused, and as fast as it goes
        False
    """

    def __init__(self, meshcat: Meshcat, *, can_reset: bool = True) -> None:
        self._meshcat = meshcat
        self._can_reset = can_reset
        self._last = (0.0, time.perf_counter())  # Simulated and wall time of the last frame.
        self._view: tuple[ArrayLike, ArrayLike] | None = None
        self._num_visitors = 0
        meshcat.AddButton(_PAUSE, "Space")
        meshcat.AddButton(_STEP, "ArrowRight")
        if can_reset:
            meshcat.AddButton(_RESET)
        meshcat.AddSlider(_SPEED, 0.0, 4.0, 0.1, 0.0)
        meshcat.AddSlider(_FITNESS, 0.0, 1.0, 0.001, 0.0)
        meshcat.AddSlider(_CONFIDENCE, 0.0, 1.0, 0.001, 0.0)

    def LookFrom(self, eye: ArrayLike, look_at: ArrayLike) -> None:
        """Places the camera of the page, also of browsers that come later; see `SetView`.

        Args:
            eye: Where it looks from [m], in the world.
            look_at: What is in the middle [m].
        """
        self._view = (eye, look_at)
        SetView(self._meshcat, eye, look_at)

    def Tell(self, fitness: float, confidence: float, state: TrackingState) -> None:
        """Shows what the recognition says of itself.

        Args:
            fitness: The pose's fitness, 0 to 1.
            confidence: That it is right, 0 to 1; NaN, which is shown as 0 and told beside the
                state, where it is not known.
            state: What the tracker says of it.
        """
        self._meshcat.SetSliderValue(_FITNESS, fitness)
        self._meshcat.SetSliderValue(_CONFIDENCE, 0.0 if math.isnan(confidence) else confidence)
        unknown = ", confidence unknown" if math.isnan(confidence) else ""
        wanted = f"state: {state.name.lower()}{unknown}"
        shown = [name for name in self._meshcat.GetButtonNames() if name.startswith("state: ")]
        if shown != [wanted]:
            for name in shown:
                self._meshcat.DeleteButton(name)
            self._meshcat.AddButton(wanted)

    def Wait(self, simulated: float, is_ended: Callable[[], bool] = lambda: False) -> bool:
        """Keeps the pace after a frame, and stays while it is paused.

        Args:
            simulated: Time of the frame [s].
            is_ended: Asked while waiting; when it returns True there is no more waiting.

        Returns:
            Whether to begin anew.
        """
        visitors = self._meshcat.GetNumActiveConnections()
        if self._view is not None and visitors > self._num_visitors:
            # Meshcat tells those who come late where its camera is, but not where it looks to.
            SetView(self._meshcat, *self._view)
        self._num_visitors = visitors
        before, began = self._last
        while not is_ended():
            if self._can_reset and self._meshcat.GetButtonClicks(_RESET):
                self._meshcat.AddButton(_RESET)  # That counts its clicks from 0 again.
                self._last = (0.0, time.perf_counter())
                return True
            stepped = self._meshcat.GetButtonClicks(_STEP) > 0
            if stepped:  # Where nothing is paused there is nothing to step.
                self._meshcat.AddButton(_STEP, "ArrowRight")
            if self._meshcat.GetButtonClicks(_PAUSE) % 2:
                if stepped:
                    break
            else:
                # So much simulated time could have passed by now.
                passed = self._meshcat.GetSliderValue(_SPEED) * (time.perf_counter() - began)
                if passed == 0.0 or passed >= simulated - before:
                    break
            time.sleep(_POLL)
        self._last = (simulated, time.perf_counter())
        return False
