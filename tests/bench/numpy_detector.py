"""The paper's detector in NumPy, the peer of `cargo xtask bench`: stick ratio, Coulomb baseline, moment, centre of pressure.

numpy_detector.py MAPS.npy MU THRESHOLD CONTACT_MIN: (T, 3, 20, 20) float32 newtons, channels x, y, z. Reads words from standard
input, one a line, and answers each with one line of JSON: `decide` (contact, stick, slip of every map), `batch` (seconds for all maps in one
call), `frames N` (seconds for one call a map, printed for every N of them). One thread.
"""

import json
import sys
import time

import numpy as np

PITCH_MM = 1.6
SIDE = 20

place = (np.arange(SIDE, dtype=np.float32) - (SIDE - 1) / 2) * np.float32(PITCH_MM)
X_MM, Y_MM = np.meshgrid(place, place)


def detect(maps, mu, threshold, contact_min):
    fx, fy, fz = maps[:, 0], maps[:, 1], maps[:, 2]
    contact = fz > contact_min
    stick = contact & (fx * fx + fy * fy <= mu * mu * (fz * fz))
    contacts = np.count_nonzero(contact, axis=(1, 2))
    sticks = np.count_nonzero(stick, axis=(1, 2))
    slip = sticks < threshold * contacts
    force = maps.sum(axis=(2, 3))
    coulomb = np.hypot(force[:, 0], force[:, 1]) > mu * force[:, 2]
    moment = (X_MM * fy - Y_MM * fx).sum(axis=(1, 2))
    pressure = (X_MM * fz).sum(axis=(1, 2)), (Y_MM * fz).sum(axis=(1, 2))
    return contacts, sticks, slip, force, coulomb, moment, pressure


def main():
    maps = np.load(sys.argv[1])
    rule = tuple(np.float32(word) for word in sys.argv[2:5])
    for word in sys.stdin:
        word = word.strip()
        start = time.perf_counter()
        if word == "decide":
            contacts, sticks, slip, *_ = detect(maps, *rule)
            answer = {
                "numpy": np.__version__,
                "contact": contacts.tolist(),
                "stick": sticks.tolist(),
                "slip": slip.tolist(),
            }
        elif word == "batch":
            detect(maps, *rule)
            answer = {"seconds": [time.perf_counter() - start]}
        elif word.startswith("frames "):
            step, seconds = int(word.split()[1]), []
            for begin in range(0, len(maps), step):
                start = time.perf_counter()
                for frame in range(begin, min(begin + step, len(maps))):
                    detect(maps[frame : frame + 1], *rule)
                seconds.append(time.perf_counter() - start)
            answer = {"seconds": seconds}
        else:
            sys.exit(f"numpy_detector.py: found {word!r}, expected decide, batch or frames N")
        print(json.dumps(answer), flush=True)


if __name__ == "__main__":
    main()
