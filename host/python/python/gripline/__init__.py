"""From a camera-based tactile fingertip to a grip-force line that does not let the object slip.

Force maps are arrays (T, 3, 20, 20) in newtons: frames, channels x, y and z, rows, columns; z presses into the skin. Nothing
is converted or copied on the way in. Long work runs without the interpreter's lock. What cannot be done raises
``GriplineError``, a wrong array ``TypeError`` or ``ValueError``; each says what was found, what was expected and what to do.

``Detector`` and ``Controller`` are the microcontroller's own library, ``ForceNetwork`` makes maps of pictures, ``Scene`` and
``TrainingSamples`` are the simulated world, ``read_recording`` reads what ``gripline run --record`` wrote, and ``Client``
speaks to a running bridge.
"""

from __future__ import annotations

from ._gripline import (
    Controller,
    Detector,
    ForceNetwork,
    GriplineError,
    Scene,
    TrainingSamples,
    __version__,
    read_recording,
    scenes,
)

__all__ = [
    "Client",
    "ControlError",
    "Controller",
    "Detector",
    "ForceNetwork",
    "GriplineError",
    "Scene",
    "TrainingSamples",
    "__version__",
    "read_recording",
    "scenes",
]


def __getattr__(name: str) -> object:
    # The client brings HTTP, which takes longer to import than all the rest.
    if name in ("Client", "ControlError"):
        from . import client

        return getattr(client, name)
    raise AttributeError(f"module 'gripline' has no attribute '{name}'")
