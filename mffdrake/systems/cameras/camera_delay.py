"""A camera that is late: what its images show has happened some time ago."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydrake.common.value import AbstractValue
from pydrake.geometry import FramePoseVector
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import BodyIndex
from pydrake.systems.framework import Context, DiagramBuilder, LeafSystem, OutputPort
from pydrake.systems.primitives import AffineSystem, DiscreteTimeDelay

from mffdrake.systems.callbacks import WeakCallback
from mffdrake.systems.finite import EvalFinite
from mffdrake.systems.timing import Timing

__all__ = ["AddDelay", "GeometryPoser"]


def AddDelay(
    builder: DiagramBuilder,
    signal: OutputPort,
    *,
    latency: float,
    initial_value: ArrayLike,
    timing: Timing | None = None,
    name: str = "delay",
) -> OutputPort:
    """Delays a vector by some control periods.

    To make cameras late, delay the state that poses the scene before them: a scene that is drawn
    late is drawn but once, whereas images would have to be stored.

    Args:
        builder: The builder of the diagram.
        signal: The port to delay, of size n.
        latency: The delay [s], a whole multiple of the control period; 0 adds nothing.
        initial_value: The delayed signal until the latency has passed, shape (n,).
        timing: Gives the control period; 1 ms by default.
        name: First part of the added systems' names.

    Returns:
        The port of the delayed signal; without latency, the signal itself.

    Raises:
        ValueError: When the latency is no such multiple or negative.

    Example:
        >>> from pydrake.systems.primitives import ConstantVectorSource
        >>> builder = DiagramBuilder()
        >>> source = builder.AddSystem(ConstantVectorSource([3.0]))
        >>> delayed = AddDelay(builder, source.get_output_port(), latency=0.066, initial_value=[2])
        >>> diagram = builder.Build()
        >>> delayed.Eval(delayed.get_system().GetMyContextFromRoot(diagram.CreateDefaultContext()))
        array([2.])
    """
    timing = Timing() if timing is None else timing
    timing.CheckLatency(latency)
    if timing.Tick(latency) == 0:
        return signal
    # Drake's delay changes in the event at a tick, which comes after that tick's other events have
    # seen it: one more tick. It begins with zeros, so it is given the deviation from the initial
    # value.
    start = np.array(initial_value, dtype=float)
    deviation = builder.AddNamedSystem(f"{name}_input", _Offset(-start))
    delay = builder.AddNamedSystem(
        name, DiscreteTimeDelay(timing.control_period, timing.Tick(latency) - 1, start.size)
    )
    delayed = builder.AddNamedSystem(f"{name}_output", _Offset(start))
    builder.Connect(signal, deviation.get_input_port())
    builder.Connect(deviation.get_output_port(), delay.get_input_port())
    builder.Connect(delay.get_output_port(), delayed.get_input_port())
    return delayed.get_output_port()


def _Offset(offset: NDArray[np.float64]) -> AffineSystem:
    """Y = u + offset."""
    n = offset.size
    return AffineSystem(
        A=np.zeros((0, 0)), B=np.zeros((0, n)), f0=np.zeros(0),
        C=np.zeros((n, 0)), D=np.eye(n), y0=offset,
    )  # fmt: skip


class GeometryPoser(LeafSystem):
    """Poses a plant's geometries in a scene, from any state instead of the plant's own.

    .. pydrake_system::

        name: GeometryPoser
        input_ports:
        - state
        output_ports:
        - geometry_pose

    Drake's MultibodyPositionToGeometryPose does the same, but keeps a plant of the same diagram
    alive, and thereby the diagram, for good.

    Ports:
        state: The plant's state, positions first.
        geometry_pose: The poses of its bodies' frames (FramePoseVector), for a SceneGraph.

    Args:
        plant: A finalized plant that is registered with a SceneGraph.

    Example:
        >>> from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
        >>> plant, scene_graph = AddMultibodyPlantSceneGraph(DiagramBuilder(), time_step=0.001)
        >>> plant.Finalize()
        >>> GeometryPoser(plant).GetOutputPort("geometry_pose").get_name()
        'geometry_pose'
    """

    def __init__(self, plant: MultibodyPlant) -> None:
        super().__init__()
        self._plant = plant
        # Scratch space for kinematics, written before every use: it carries no state.
        self._kinematics = plant.CreateDefaultContext()
        bodies = [plant.get_body(BodyIndex(k)) for k in range(1, plant.num_bodies())]  # 0: world
        frames = [(plant.GetBodyFrameIdIfExists(body.index()), body) for body in bodies]
        self._frames = [(frame, body) for frame, body in frames if frame is not None]
        self._state = self.DeclareVectorInputPort("state", plant.num_multibody_states())
        self.DeclareAbstractOutputPort(
            "geometry_pose",
            lambda: AbstractValue.Make(FramePoseVector()),
            WeakCallback(self._CalcGeometryPose),
        )

    def _CalcGeometryPose(self, context: Context, output: AbstractValue) -> None:
        positions = EvalFinite(self, self._state, context)[: self._plant.num_positions()]
        self._plant.SetPositions(self._kinematics, positions)
        poses = FramePoseVector()
        for frame, body in self._frames:
            poses.set_value(frame, body.EvalPoseInWorld(self._kinematics))
        output.set_value(poses)
