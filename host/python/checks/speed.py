"""Import and detector beside the command line, in one run: `cargo xtask wheel --bench`.

python speed.py GRIPLINE WHEEL [--json]   (the program `gripline`, built for release; the installed wheel)

The detector judges 1,000 maps of 20 x 20 taxels; `gripline detect` without --csv judges the same file. What both need to
start is taken out: of the command line the time of a file of one map, of Python its start and imports. Rounds alternate, the
median of each side counts. Exit code 1 when a bound does not hold.
"""

import json
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import gripline

FRAMES = 1_000
ROUNDS = 31
IMPORT_MAX_MS = 100.0
RATIO_MAX = 1.1


def took_ms(call):
    start = time.perf_counter()
    call()
    return (time.perf_counter() - start) * 1e3


def main(program, wheel, *options):
    random = np.random.default_rng(1)
    maps = random.normal(0.0, 0.15, (FRAMES, 3, 20, 20)).astype(np.float32)
    maps[:, 2] = np.abs(maps[:, 2]) * (random.random((FRAMES, 20, 20)) < 0.4)
    detector = gripline.Detector()
    detector(maps)
    ours, whole, start, imports, bare = [], [], [], [], []
    with tempfile.TemporaryDirectory() as folder:
        many, one = Path(folder, "many.npy"), Path(folder, "one.npy")
        np.save(many, maps)
        np.save(one, maps[:1])

        def detect(path):
            subprocess.run([program, "detect", path], check=True, stdout=subprocess.DEVNULL)

        def python(code):
            subprocess.run([sys.executable, "-c", code], check=True)

        for _ in range(ROUNDS):
            ours.append(took_ms(lambda: detector(maps)))
            whole.append(took_ms(lambda: detect(many)))
            start.append(took_ms(lambda: detect(one)))
            imports.append(took_ms(lambda: python("import gripline")))
            bare.append(took_ms(lambda: python("")))
    ours, whole, start = (statistics.median(times) for times in (ours, whole, start))
    imported = statistics.median(imports) - statistics.median(bare)
    ratio = ours / (whole - start)
    if "--json" in options:
        found = {
            "wheel_bytes": Path(wheel).stat().st_size,
            "import_ms": imported,
            "detector_ms": ours,
            "detect_ms": whole,
            "detect_start_ms": start,
            "ratio": ratio,
        }
        print(json.dumps(found))
    else:
        print(f"import gripline: {imported:.1f} ms beyond Python's own start; bound {IMPORT_MAX_MS:.0f}")
        print(
            f"{FRAMES} maps: Detector {ours:.2f} ms; gripline detect {whole:.2f} ms, of which {start:.2f} for one map; "
            f"ratio {ratio:.2f} without the start, {ours / whole:.2f} with it; bound {RATIO_MAX}"
        )
    return 0 if imported <= IMPORT_MAX_MS and ratio <= RATIO_MAX else 1


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
