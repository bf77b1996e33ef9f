"""NumPy's random numbers in compiled functions (numba). Import only where it runs.

Numba reads a `numpy.random.Generator` that a compiled function is given by calls of Python, which
take a while, and end the process where Ctrl-C comes meanwhile. Its address is only a number.
"""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

__all__ = ["address_of", "generator_at"]

_MEMBERS = ("state", "fnptr_next_uint64", "fnptr_next_uint32", "fnptr_next_double")
"""How ``bitgen_t`` of NumPy's C API begins, by numba's names."""

_read_capsule = ctypes.PYFUNCTYPE(ctypes.c_void_p, ctypes.py_object, ctypes.c_char_p)(
    ("PyCapsule_GetPointer", ctypes.pythonapi)
)


def address_of(rng: np.random.Generator) -> int:
    """Where a generator's ``bitgen_t`` is, for as long as the generator is kept."""
    address: int = _read_capsule(rng.bit_generator.capsule, b"BitGenerator")
    return address


@intrinsic
def generator_at(_: Any, address: Any) -> Any:
    """The generator at an address, for compiled functions."""

    def build(context: Any, builder: Any, _: Any, args: Any) -> Any:
        members = builder.inttoptr(args[0], ir.IntType(64).as_pointer())
        bits = cgutils.create_struct_proxy(types.npy_bitgen)(context, builder)
        for k, name in enumerate(_MEMBERS):
            place = builder.gep(members, [ir.Constant(ir.IntType(32), k)])
            setattr(bits, name, builder.load(place))
        # Python's object and the count of its users stay null: whoever knows the address keeps it.
        rng = cgutils.create_struct_proxy(types.npy_rng)(context, builder)
        rng.bit_generator = bits._getvalue()
        return rng._getvalue()

    return types.npy_rng(types.uintp), build
