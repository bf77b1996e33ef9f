"""Puts disturbances one behind the other between cameras and their reader."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from pydrake.systems.framework import DiagramBuilder, OutputPort

from mffdrake.recognition.parameters import kind_of
from mffdrake.systems.disturbances.image_disturbance import ImageDisturbance
from mffdrake.systems.timing import Timing

__all__ = ["AddDisturbances"]


def AddDisturbances(
    builder: DiagramBuilder,
    images: Mapping[str, OutputPort],
    disturbances: Sequence[ImageDisturbance],
    *,
    seed: int = 0,
    timing: Timing | None = None,
) -> dict[str, OutputPort]:
    """Adds disturbances to the images of cameras, the first one nearest to the cameras.

    Args:
        builder: Receives the systems.
        images: Cameras' names to the ports of their images.
        disturbances: What disturbs them, in this order.
        seed: Of the random numbers, at least 0.
        timing: Control and vision periods; 1 ms and 33 ms by default.

    Returns:
        Cameras' names to the ports of their disturbed images.

    Raises:
        ValueError: When a disturbance names a camera that there is not, or does not suit the
            periods.

    Example:
        >>> from mffdrake.systems.disturbances import Black
        >>> AddDisturbances(DiagramBuilder(), {}, [Black(cameras=["top"])])
        Traceback (most recent call last):
        ...
        ValueError: disturbance 0, black: cameras must be some of none, not 'top'
    """
    timing = Timing() if timing is None else timing
    disturbed = dict(images)
    for index, disturbance in enumerate(disturbances):
        for name in disturbance.cameras or ():
            if name not in images:
                raise ValueError(
                    f"disturbance {index}, {kind_of(type(disturbance))}: cameras must be some of "
                    f"{', '.join(images) or 'none'}, not '{name}'"
                )
        for camera, image in disturbed.items():
            disturbed[camera] = disturbance.AddToBuilder(
                builder, image, camera=camera, index=index, seed=seed, timing=timing
            )
    return disturbed
