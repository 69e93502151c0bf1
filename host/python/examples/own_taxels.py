"""Slip from one's own taxel array: 8 x 8 taxels of (x, y, z) counts, 100 frames a second, through Gripline's controller.

The array here is made up: an object of 2 N is held with 4 N at a friction of 0.6 and pulled until it slides.
"""

import numpy as np

import gripline

NEWTONS_PER_COUNT = 0.001
RATE_HZ = 100.0


def taxels() -> np.ndarray:
    """Counts as a driver gives them, (T, rows, columns, 3)."""
    frames = 300
    column, row = np.meshgrid(np.arange(8) - 3.5, np.arange(8) - 3.5)
    pressure = np.clip(1.0 - (column**2 + row**2) / 12.0, 0.0, None)
    normal = 4.0 * pressure / pressure.sum()
    # The edge of a contact carries all it can first; the middle follows.
    pull = np.clip(np.linspace(0.0, 3.6, frames), 0.0, 0.6 * 4.0)
    counts = np.zeros((frames, 8, 8, 3))
    for frame, force in enumerate(pull):
        most = 0.6 * normal
        shear = np.full_like(normal, force / (normal > 0).sum()) * (normal > 0)
        for _ in range(50):
            shear = np.minimum(shear, most)
            room = most - shear
            if room.sum() < 1e-9:
                break
            shear += (force - shear.sum()) * room / room.sum()
        counts[frame, ..., 0] = np.minimum(shear, most)
        counts[frame, ..., 2] = normal
    return np.rint(counts / NEWTONS_PER_COUNT)


def main() -> int:
    # Gripline wants the channels on axis 1; nothing is copied.
    maps = np.moveaxis(taxels(), -1, 1)
    controller = gripline.Controller(mu=0.58, scale=NEWTONS_PER_COUNT, rate_hz=RATE_HZ)
    said = controller(maps)
    slips = np.flatnonzero(said["state"] == "SLIP")
    first = int(slips[0])
    print(f"SLIP from frame {first} ({first / RATE_HZ:.2f} s) on, at {said['ft'][first]:.2f} N of shear")
    print(f"grip-force line: {said['line_n'][0]:.2f} N at the start, {said['line_n'][-1]:.2f} N at the end")
    return first


if __name__ == "__main__":
    main()
