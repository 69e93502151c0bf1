"""The native half of the package. Shapes stand in the docstrings: T frames, F fingers, N samples, H rows and W columns of pixels."""

import os
from collections.abc import Iterator
from typing import Literal, final

import numpy as np
from numpy.typing import NDArray

from .results import Batch, Controlled, Inferred, Judged, Recording, SceneFrame

__all__ = [
    "__version__",
    "GriplineError",
    "Detector",
    "Controller",
    "ForceNetwork",
    "Scene",
    "TrainingSamples",
    "scenes",
    "read_recording",
]

__version__: str

class GriplineError(Exception):
    """Something that Gripline was asked for cannot be done: what was found, what was expected and what to do."""

@final
class Detector:
    """The microcontroller's slip detector over force maps, each map for itself alone.

    mu: friction coefficient, 0 to 2 in steps of 0.0001.
    threshold: a frame slips when its stick ratio is below this, 0 to 1 in steps of 0.0001.
    contact_min: a taxel is in contact when its normal force exceeds this, newtons, 0 to 8.
    scale: newtons per unit of the maps.
    pitch_mm: distance of neighbouring taxels, 0.1 to 10, for mz.
    """

    def __new__(
        cls,
        mu: float = 0.45,
        threshold: float = 0.5,
        contact_min: float = 0.0,
        scale: float = 1.0,
        pitch_mm: float = 1.6,
    ) -> Detector: ...
    def __call__(self, maps: NDArray[np.float32] | NDArray[np.float64]) -> Judged:
        """Judges maps of shape (T, 3, R, C) in newtons, R and C up to 20; a smaller grid sits in the corner of an empty map."""

@final
class Controller:
    """The microcontroller's slip detector, slip state machine and grip controller, shown one map after the other.

    It holds from before the first map, and a call goes on where the last one stopped.
    mu, threshold, contact_min, scale, pitch_mm: as those of Detector.
    rate_hz: maps per second, 10 to 1000; its clock is that of the maps.
    """

    def __new__(
        cls,
        mu: float = 0.45,
        threshold: float = 0.5,
        contact_min: float = 0.0,
        scale: float = 1.0,
        rate_hz: float = 60.0,
        pitch_mm: float = 1.6,
    ) -> Controller: ...
    def __call__(self, maps: NDArray[np.float32] | NDArray[np.float64]) -> Controlled:
        """Shows maps of shape (T, 3, R, C) in newtons, R and C up to 20."""

@final
class ForceNetwork:
    """The force network of a fingertip: pictures in, maps of contact forces out.

    rest: the untouched fingertip, (H, W) uint8, 640x480, 440x440 or, for 'unet', 88x88.
    network: 'tracked' follows particles at full resolution, 'unet' looks at small images.
    weights: a safetensors file instead of the built-in weights.
    sensor: a shipped sensor's name or a TOML file; says where in a picture the fingertip is.
    gain: factors on shear and normal force: gel.shear_gain and gel.normal_gain of a file that `gripline calibrate gel` wrote.
    engine: 'skip' computes only what can differ from the picture before, 'dense' all; the maps are the same.
    """

    def __new__(
        cls,
        rest: NDArray[np.uint8],
        *,
        network: Literal["tracked", "unet"] = "tracked",
        weights: str | os.PathLike[str] | None = None,
        sensor: str | os.PathLike[str] | None = None,
        gain: tuple[float, float] | None = None,
        engine: Literal["skip", "dense"] = "skip",
    ) -> ForceNetwork: ...
    def infer(self, pictures: NDArray[np.uint8]) -> Inferred:
        """Infers the forces of pictures of shape (T, H, W), of the sizes that rest may have."""

@final
class Scene(Iterator[SceneFrame]):
    """A scene of the simulated world, played frame by frame: iterate over it once.

    scene: the name of a shipped scene (see scenes()) or a TOML file.
    seed: instead of the scene's.
    size: 'crop' for pictures of 440x440, 'full' for 640x480; by default what the scene says.
    pictures: False leaves the pictures out, which is much faster.
    """

    frames: int
    """Frames of the whole scene."""
    fingers: int
    """Fingers that look."""
    frames_per_second: float
    seed: int
    rest: NDArray[np.uint8]
    """Pictures before anything touches, (F, H, W)."""
    unsolved: list[tuple[float, str, str]]
    """Frames that were left out so far: time in seconds, phase and why."""

    def __new__(
        cls,
        scene: str | os.PathLike[str],
        *,
        seed: int | None = None,
        size: Literal["crop", "full"] | None = None,
        pictures: bool = True,
    ) -> Scene: ...
    def __len__(self) -> int: ...
    def __iter__(self) -> Scene: ...
    def __next__(self) -> SceneFrame: ...

@final
class TrainingSamples:
    """An endless stream of random samples of the simulated world: the same seed and split give the same samples.

    seed: streams of other seeds differ in everything.
    split: no two share a virtual sensor or a random surface.
    size: 'small' for pictures of 88x88, 'crop' for 440x440.
    """

    def __new__(
        cls,
        seed: int,
        *,
        split: Literal["train", "validation", "calibration", "test"] = "train",
        size: Literal["small", "crop"] = "small",
    ) -> TrainingSamples: ...
    def batch(self, count: int) -> Batch:
        """The next count samples."""

def scenes() -> list[str]:
    """The names of the scenes that come with the package."""

def read_recording(path: str | os.PathLike[str], *, sensor: int = 0, pictures: bool = True) -> Recording:
    """Reads a recording of ``gripline run --record`` into memory.

    sensor: the fingertip, 0 or 1. pictures: False leaves the pictures out.
    """
