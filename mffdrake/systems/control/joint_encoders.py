"""Joint encoders that read with an error."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from mffdrake.systems.callbacks import WeakCallback
from mffdrake.systems.timing import Timing

__all__ = ["JointEncoders"]


class JointEncoders(LeafSystem):
    """Reads the joint positions of an arm's state with errors: noise, offset and rounding.

    .. pydrake_system::

        name: JointEncoders
        input_ports:
        - state
        output_ports:
        - estimated_state

    It has no state: the noise depends on the seed and on the number of the control tick alone, and
    is another one at every tick. Noise and offset add up, and their sum with the position is then
    rounded to the resolution. The velocities pass unchanged.

    Ports:
        state: The n joints' positions [rad], then velocities [rad/s], shape (2n,).
        estimated_state: The same as read.

    Args:
        num_joints: Number n of joints.
        noise: Standard deviation of a position's normal error [rad], at least 0; independent of
            the other joints' errors and of those at other ticks.
        offset: Constant error of the positions [rad]: one number, or one for each joint.
        resolution: Step of the positions that can be read [rad]; 0 for no rounding.
        seed: Of the noise, at least 0.
        timing: Gives the control period; 1 ms by default.

    Raises:
        ValueError: When an argument is outside its range.

    Example:
        >>> encoders = JointEncoders(num_joints=1, noise=0.001)
        >>> context = encoders.CreateDefaultContext()
        >>> _ = encoders.get_input_port().FixValue(context, [0.5, 0.1])
        >>> encoders.get_output_port().Eval(context).round(2)
        array([0.5, 0.1])
    """

    def __init__(
        self,
        *,
        num_joints: int = 7,
        noise: float = 0.0,
        offset: ArrayLike = 0.0,
        resolution: float = 0.0,
        seed: int = 0,
        timing: Timing | None = None,
    ) -> None:
        super().__init__()
        if num_joints < 1:
            raise ValueError(f"JointEncoders: num_joints must be at least 1, not {num_joints}")
        if not 0.0 <= noise < math.inf:
            raise ValueError(f"JointEncoders: noise must be at least 0 rad, not {noise}")
        offsets = np.array(offset, dtype=float)
        if offsets.shape not in ((), (num_joints,)) or not np.isfinite(offsets).all():
            raise ValueError(
                f"JointEncoders: offset must be one finite number or {num_joints} of them, one for "
                f"each joint, in rad, not {offsets.tolist()}"
            )
        if not 0.0 <= resolution < math.inf:
            raise ValueError(
                f"JointEncoders: resolution must be at least 0 rad (0 for no rounding), not "
                f"{resolution}"
            )
        if seed < 0:
            raise ValueError(f"JointEncoders: seed must be at least 0, not {seed}")
        self._timing = Timing() if timing is None else timing
        self._num_joints, self._noise, self._seed = num_joints, noise, seed
        self._offset, self._resolution = offsets, resolution
        self._state = self.DeclareVectorInputPort("state", 2 * num_joints)
        self.DeclareVectorOutputPort(
            "estimated_state", 2 * num_joints, WeakCallback(self._CalcEstimatedState)
        )

    def _CalcEstimatedState(self, context: Context, output: BasicVector) -> None:
        state = self._state.Eval(context)
        # The key keeps this stream apart from the recognizer's, keyed by seed and frame.
        counter = [0, 0, 0, self._timing.Tick(context.get_time())]
        rng = np.random.Generator(np.random.Philox(key=[self._seed, 2**63], counter=counter))
        positions = state[: self._num_joints]
        positions += self._noise * rng.standard_normal(self._num_joints)
        positions += self._offset
        if self._resolution > 0.0:
            positions[:] = self._resolution * np.rint(positions / self._resolution)
        output.SetFromVector(state)
