"""The types of results, for type checkers. Shapes: T frames, F fingers, N samples, S pixels a side."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypedDict

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


class Judged(TypedDict):
    """Results of Detector: arrays (T,).

    fn, fx, fy and ft are newtons, mz N mm about the middle of the map, contact and stick taxels, stick_ratio NaN where nothing
    touches, saturated components beyond 8 N that were clipped.
    """

    frame: NDArray[np.int64]
    fn: NDArray[np.float64]
    fx: NDArray[np.float64]
    fy: NDArray[np.float64]
    ft: NDArray[np.float64]
    mz: NDArray[np.float64]
    contact: NDArray[np.uint16]
    stick: NDArray[np.uint16]
    stick_ratio: NDArray[np.float64]
    coulomb_slip: NDArray[np.bool_]
    slip: NDArray[np.bool_]
    saturated: NDArray[np.uint16]


class Controlled(Judged):
    """Results of Controller: the same and three more arrays (T,).

    state is 'NO_CONTACT', 'STICK', 'INCIPIENT' or 'SLIP', slip_evidence 0 to 1, line_n the grip-force line in newtons.
    """

    state: NDArray[np.str_]
    slip_evidence: NDArray[np.float64]
    line_n: NDArray[np.float64]


class Inferred(TypedDict):
    """Results of ForceNetwork.

    maps (T, 3, 20, 20) are newtons per taxel, health (T,) is 'good' or what is known against the picture.
    """

    maps: NDArray[np.float32]
    good: NDArray[np.bool_]
    health: NDArray[np.str_]


class SceneFrame(TypedDict):
    """A frame of a Scene: truth by name as in truth.csv, maps (F, 3, 20, 20) in newtons per taxel, pictures (F, H, W) or None."""

    truth: dict[str, Any]
    maps: NDArray[np.float32]
    pictures: NDArray[np.uint8] | None


class Batch(TypedDict):
    """A batch of TrainingSamples.

    rest and now are (N, S, S), maps (N, 3, 20, 20) in newtons per taxel, the others (N,), NaN where nothing touches.
    """

    rest: NDArray[np.uint8]
    now: NDArray[np.uint8]
    maps: NDArray[np.float32]
    stick_ratio: NDArray[np.float64]
    friction: NDArray[np.float64]
    gross_slip: NDArray[np.bool_]
    shape: NDArray[np.str_]
    sensor: NDArray[np.uint64]


class Recording(TypedDict):
    """A recording.

    maps (T, 3, 20, 20) are newtons per taxel, pictures (T, S, S) or None unless every frame has one, rest (N, 440, 440),
    columns arrays (T,) as in frames.csv, truncated None or why the file was cut short.
    """

    maps: NDArray[np.float32]
    pictures: NDArray[np.uint8] | None
    rest: NDArray[np.uint8]
    columns: dict[str, NDArray[Any]]
    metadata: dict[str, str]
    truncated: str | None
