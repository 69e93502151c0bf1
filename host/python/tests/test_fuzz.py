"""Whatever array comes in, a result or an ordinary error goes out: no panic, no crash.

Three seconds by default; GRIPLINE_FUZZ_SECONDS says otherwise, GRIPLINE_FUZZ_SEED where it begins.
"""

import os
import time

import numpy as np

import gripline

SECONDS = float(os.environ.get("GRIPLINE_FUZZ_SECONDS", "3"))
SEED = int(os.environ.get("GRIPLINE_FUZZ_SEED", "0"))
DTYPES = "?bBhHiIqQefdgFDUSOMV"
SPECIAL = [0.0, -0.0, np.nan, np.inf, -np.inf, 1e308, -1e308, 1e-320, 7.9998, 8.0, -8.0, 2.0**31, 2.0**63]


def array(random, good_shape, good_dtypes):
    """Something like an array for one of the calls; about half of them could be one."""
    shape = list(good_shape)
    for _ in range(random.integers(0, 3)):
        what = random.integers(0, 4)
        place = random.integers(0, len(shape)) if shape else 0
        if what == 0 and shape:
            shape[place] = int(random.choice([0, 1, 2, 3, 4, 19, 20, 21]))
        elif what == 1 and shape:
            del shape[place]
        elif what == 2 and len(shape) < 6:
            shape.insert(place, int(random.integers(0, 3)))
    dtype = random.choice(list(good_dtypes if random.random() < 0.7 else DTYPES))
    dtype = np.dtype({"U": "U3", "S": "S3", "V": "V4", "M": "M8[s]"}.get(dtype, dtype))
    if random.random() < 0.1:
        dtype = dtype.newbyteorder()
    count = int(np.prod(shape, dtype=int))
    if dtype.kind in "iufcb?":
        with np.errstate(all="ignore"):
            numbers = random.normal(0.0, random.choice([0.01, 1.0, 1e4]), count)
            if count and random.random() < 0.3:
                numbers[random.integers(0, count, 3)] = random.choice(SPECIAL, 3)
            made = numbers.astype(dtype).reshape(shape)
    else:
        made = np.zeros(shape, dtype)
    what = random.integers(0, 8)
    if what == 0 and made.ndim:
        made = np.asfortranarray(made)
    elif what == 1 and made.ndim:
        made = made[tuple(slice(None, None, int(random.choice([-1, 2, -3]))) for _ in shape)]
    elif what == 2 and made.ndim and dtype.kind in "fiu":
        raw = np.zeros(made.nbytes + 1, np.uint8)
        odd = raw[1:].view(dtype).reshape(made.shape)
        odd[...] = made
        made = odd
    elif what == 3 and made.ndim:
        made = np.broadcast_to(made[..., :1], made.shape) if made.shape[-1] else made
    elif what == 4 and made.ndim > 1:
        made = made.swapaxes(0, -1)
    elif what == 5:
        made = random.choice([0, 1, 2], 1)[0] if random.random() < 0.5 else made.view(np.matrix if made.ndim == 2 else None or np.ndarray)
    elif what == 6 and made.ndim:
        made = np.ma.masked_array(made)
    return made


def test_any_array_gives_a_result_or_an_ordinary_error():
    rest = np.random.default_rng(1).integers(0, 90, (88, 88), dtype=np.uint8)
    calls = [
        (gripline.Detector(), (4, 3, 20, 20), "fd"),
        (gripline.Detector(scale=1e300, mu=2.0), (4, 3, 7, 20), "fd"),
        (gripline.Controller(), (4, 3, 20, 20), "fd"),
        (gripline.ForceNetwork(rest, network="unet").infer, (2, 88, 88), "B"),
        (lambda pictures: gripline.ForceNetwork(pictures, network="unet"), (88, 88), "B"),
    ]
    answered = refused = 0
    seed, until = SEED, time.monotonic() + SECONDS
    while time.monotonic() < until:
        random = np.random.default_rng(seed)
        call, shape, dtypes = calls[random.choice(len(calls), p=[0.3, 0.2, 0.3, 0.1, 0.1])]
        given = array(random, shape, dtypes)
        try:
            call(given)
            answered += 1
        except (TypeError, ValueError) as error:
            assert "found" in str(error) and "expected" in str(error), f"seed {seed}: {error}"
            refused += 1
        except BaseException as error:
            raise AssertionError(f"seed {seed}: {type(error)} for {getattr(given, 'shape', given)}") from error
        seed += 1
    print(f"{answered} answered, {refused} refused, seeds {SEED} to {seed - 1}")
    assert answered > 20 and refused > 20
