"""Tells whether this machine can render through EGL, and if not, what is missing.

Run as a script, it prints one line of JSON, `{"status": ..., "detail": ...}`, and exits with 0
when rendering works and with 1 when it does not. It uses the standard library only and needs
neither the package nor Drake, so `tools/dev.py` can run it before anything is installed.

A broken driver may crash the process: call it in a subprocess, and take a death by signal for "no
working driver". It repeats the calls of `RenderEngineVtk`'s first render, where Drake would crash.

| status | meaning |
|---|---|
| `works` | an OpenGL context was made; `detail` names the renderer |
| `no-glib` | libglib-2.0.so.0 does not load, so `import pydrake` fails |
| `no-libegl` | libEGL.so.1 does not load |
| `no-driver` | libEGL.so.1 is there, but no driver is registered with it |
| `driver-fails` | a driver is registered, but does not initialize or gives no OpenGL 3.2 context |
"""

import ctypes
import json
import os
import sys
from collections.abc import Callable
from typing import Any

# Numbers from EGL/egl.h, EGL/eglext.h and GL/gl.h; attribute lists end with EGL_NONE.
EGL_PLATFORM_DEVICE_EXT = 0x313F
EGL_EXTENSIONS = 0x3055
EGL_OPENGL_API = 0x30A2
GL_RENDERER = 0x1F01
EGL_NONE = 0x3038
PBUFFER_CONFIG = (
    *(0x3033, 0x0001),  # EGL_SURFACE_TYPE: EGL_PBUFFER_BIT
    *(0x3040, 0x0008),  # EGL_RENDERABLE_TYPE: EGL_OPENGL_BIT
    *(0x3024, 8, 0x3023, 8, 0x3022, 8, 0x3021, 8),  # red, green, blue, alpha sizes
    *(0x3025, 8),  # EGL_DEPTH_SIZE
    EGL_NONE,
)
PBUFFER_SIZE = (0x3057, 16, 0x3056, 16, EGL_NONE)
CONTEXT_VERSION = (0x3098, 3, 0x30FB, 2, EGL_NONE)  # OpenGL 3.2, the least VTK works with


class ProbeError(Exception):
    """Rendering does not work.

    Args:
        status: One of the failing states in the table at the top of this file.
        detail: What is missing, for people.
    """

    def __init__(self, status: str, detail: str) -> None:
        super().__init__(status, detail)
        self.status = status
        self.detail = detail


def probe() -> str:
    """Makes an OpenGL context through EGL, without a display.

    Returns:
        The name of the renderer, such as `llvmpipe (LLVM 15.0.6, 256 bits)`.

    Raises:
        ProbeError: When rendering does not work.
    """
    _load("libglib-2.0.so.0", "no-glib")
    egl = _load("libEGL.so.1", "no-libegl")
    # ctypes would cut a pointer down to an int: declare every pointer that comes back, and wrap
    # every pointer that goes in.
    pointer = ctypes.c_void_p
    egl.eglQueryString.restype = ctypes.c_char_p
    egl.eglGetProcAddress.restype = pointer
    egl.eglGetDisplay.restype = pointer
    egl.eglCreatePbufferSurface.restype = pointer
    egl.eglCreateContext.restype = pointer

    display = _first_working_display(egl)
    config, count = pointer(), ctypes.c_int()
    egl.eglBindAPI(EGL_OPENGL_API)
    if (
        not egl.eglChooseConfig(
            display, _ints(PBUFFER_CONFIG), ctypes.byref(config), 1, ctypes.byref(count)
        )
        or count.value < 1
    ):
        raise _failure(egl, "the graphics driver has no off-screen OpenGL configuration")
    context = pointer(egl.eglCreateContext(display, config, None, _ints(CONTEXT_VERSION)))
    if not context:
        raise _failure(egl, "the graphics driver gives no OpenGL 3.2 context")
    surface = pointer(egl.eglCreatePbufferSurface(display, config, _ints(PBUFFER_SIZE)))
    if not surface or not egl.eglMakeCurrent(display, surface, surface, context):
        raise _failure(egl, "the graphics driver gives no off-screen surface")
    get_string = _extension(egl, "glGetString", ctypes.c_char_p, ctypes.c_uint)
    renderer: bytes | None = get_string(GL_RENDERER)
    if not renderer:
        raise _failure(egl, "the graphics driver does not answer")
    return renderer.decode(errors="replace")


def _first_working_display(egl: ctypes.CDLL) -> ctypes.c_void_p:
    """Returns the first display that initializes, in the order in which VTK tries them."""
    extensions = (egl.eglQueryString(None, EGL_EXTENSIONS) or b"").decode(errors="replace")
    needed = ("EGL_EXT_device_base", "EGL_EXT_platform_device", "EGL_EXT_platform_base")
    if not all(name in extensions for name in needed):
        displays = [egl.eglGetDisplay(None)]
    else:
        query = _extension(
            egl, "eglQueryDevicesEXT", ctypes.c_uint, ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p
        )
        get_display = _extension(
            egl,
            "eglGetPlatformDisplayEXT",
            ctypes.c_void_p,
            *(ctypes.c_uint, ctypes.c_void_p, ctypes.c_void_p),
        )
        devices, count = (ctypes.c_void_p * 64)(), ctypes.c_int()
        query(len(devices), devices, ctypes.byref(count))
        displays = [
            get_display(EGL_PLATFORM_DEVICE_EXT, devices[i], None)
            for i in _device_order(count.value)
        ]
    if not any(displays):
        raise ProbeError("no-driver", "libEGL.so.1 is there, but no graphics driver is registered")
    for display in map(ctypes.c_void_p, filter(None, displays)):
        if egl.eglInitialize(display, None, None):
            return display
    raise _failure(egl, "the graphics driver does not initialize")


def _device_order(count: int) -> list[int]:
    """Returns the device numbers in VTK's order, which obeys the variable VTK_EGL_DEVICE_INDEX."""
    chosen = os.environ.get("VTK_EGL_DEVICE_INDEX", "")
    if not chosen.isdigit() or count == 0:
        return list(range(count))
    if int(chosen) >= count:
        detail = f"VTK_EGL_DEVICE_INDEX is {chosen}, but the graphics devices end at {count - 1}"
        raise ProbeError("no-driver", detail)
    return [int(chosen)]


def _load(library: str, status: str) -> ctypes.CDLL:
    """Loads a library by its file name; `find_library` would miss those on LD_LIBRARY_PATH."""
    try:
        return ctypes.CDLL(library)
    except OSError as error:
        if str(error).startswith(f"{library}: cannot open"):
            raise ProbeError(status, f"{library} is missing") from None
        raise ProbeError(status, f"{library} does not load ({error})") from None


def _extension(egl: ctypes.CDLL, name: str, *signature: type) -> Callable[..., Any]:
    address = egl.eglGetProcAddress(name.encode())
    if not address:
        raise ProbeError("driver-fails", f"libEGL.so.1 does not offer {name}")
    return ctypes.CFUNCTYPE(*signature)(address)


def _ints(values: tuple[int, ...]) -> ctypes.Array[ctypes.c_int]:
    return (ctypes.c_int * len(values))(*values)


def _failure(egl: ctypes.CDLL, detail: str) -> ProbeError:
    return ProbeError("driver-fails", f"{detail} (EGL error 0x{egl.eglGetError():04X})")


def main() -> int:
    """Prints the result as one line of JSON and returns the exit status."""
    if sys.platform == "darwin":
        status, detail = "works", "Cocoa"
    else:
        try:
            status, detail = "works", probe()
        except ProbeError as error:
            status, detail = error.status, error.detail
        except AttributeError as error:  # a function that ctypes does not find
            status, detail = "no-libegl", f"libEGL.so.1 is not a complete EGL library ({error})"
    print(json.dumps({"status": status, "detail": detail}), flush=True)  # noqa: T201
    return 0 if status == "works" else 1


if __name__ == "__main__":
    # The answer is out: a driver that crashes while the process winds down changes nothing.
    os._exit(main())
