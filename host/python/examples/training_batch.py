"""A training batch for PyTorch as plain arrays: pictures at rest and under load in, force maps out, from the simulated world.

Torch itself is not needed to run this; with it, `torch.from_numpy` takes each array as it is.
"""

from collections.abc import Iterator

import numpy as np

import gripline


def batches(seed: int, size: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Pairs of input (N, 2, 88, 88) float32, 0 to 1, and target (N, 3, 20, 20) float32, newtons; without end."""
    samples = gripline.TrainingSamples(seed, split="train")
    while True:
        batch = samples.batch(size)
        pictures = np.stack([batch["rest"], batch["now"]], axis=1).astype(np.float32) / 255.0
        yield pictures, batch["maps"]


def main() -> None:
    pictures, maps = next(batches(seed=1, size=16))
    print(f"input {pictures.shape} {pictures.dtype}, target {maps.shape} {maps.dtype}")
    print(f"normal force of the samples: {maps[:, 2].sum(axis=(1, 2)).round(2)} N")


if __name__ == "__main__":
    main()
