"""Trains the force network after the tracker as `gripline-training train --network tracked` does, several times as fast.

The same samples, network, loss, optimiser and schedule; see README.md for what it needs and for what comes after it.
"""

import argparse
import json
import math
import struct
import time
import zlib
from pathlib import Path

import torch
from mirrored import TrackedNet
from safetensors.numpy import load_file, save

# As in `src/constants.rs`, but for the batch and the rate, which are twice and 4/3 of what stands there.
BATCH, RATE, WARM_UP, WEIGHT_DECAY = 64, 4e-3, 0.15, 1e-3
LOSS_FLOOR, SHEAR_WEIGHT, CONE_WEIGHT, CONE_LOADED = 0.02, 2.0, 0.5, 0.2
TOTAL_WEIGHT, TOTAL_FLOOR, SHEAR_FLOOR, DETECTOR_FRICTION = 3.0, 30.0, 1e-3, 0.45
NEWTONS_PER_OUTPUT, GRID_STEPS, SIDE = 0.05, 16384.0, 40


def samples_of(data, split):
    """Grids of motions [n, 6, 40, 40] and forces [n, 3, 20, 20] in output units."""
    shards = [load_file(path) for path in sorted(Path(data, f"{split}-1").glob("*.safetensors"))]
    if not shards:
        raise SystemExit(f"{data} has no {split} samples: run `gripline-training generate --samples 120000` first")
    grids = torch.cat([torch.from_numpy(shard["grid"]) for shard in shards])
    forces = torch.cat([torch.from_numpy(shard["forces_n"]) for shard in shards])
    return grids, forces.permute(0, 3, 1, 2).contiguous() / NEWTONS_PER_OUTPUT


def inputs(grids, scaling):
    """The network's input and the factor of its output, as `grid_net.rs` has them."""
    grids = grids.float() / GRID_STEPS
    near, far = grids[:, :3], grids[:, 3:]
    squares = sum(part[:, 2] * part[:, :2].square().sum(1) for part in (near, far)).sum((1, 2))
    shares = (near[:, 2] + far[:, 2]).sum((1, 2)).clamp_min(1.0)
    rms_mm = (squares / shares).sqrt().clamp_min(scaling["least_motion_mm"])[:, None, None]
    position = (torch.arange(SIDE) - (SIDE - 1) / 2) / (SIDE / 2)
    like = torch.ones(len(grids), SIDE, SIDE)
    x, y = position[None, None, :] * like, position[None, :, None] * like
    channels = [near[:, 0] / rms_mm, near[:, 1] / rms_mm, near[:, 2], far[:, 0] / rms_mm, far[:, 1] / rms_mm, far[:, 2]]
    channels += [x, y, x.square() + y.square(), (rms_mm / scaling["usual_motion_mm"]).log() * like]
    stacked = torch.stack(channels, 1).contiguous(memory_format=torch.channels_last)
    return stacked, rms_mm[:, None] * scaling["newtons_per_mm"] / NEWTONS_PER_OUTPUT


def loss(predicted, truth):
    """As `src/loss.rs` has it."""
    squares = (predicted - truth).square()
    shear = squares[:, :2].mean((1, 2, 3)) * SHEAR_WEIGHT * 2 / 3
    normal = squares[:, 2].mean((1, 2)) / 3

    def cone(forces):
        return (forces[:, :2].square().sum(1) + SHEAR_FLOOR).sqrt() - DETECTOR_FRICTION * forces[:, 2]

    is_loaded = truth[:, 2] > CONE_LOADED
    cones = ((cone(predicted) - cone(truth)).square() * is_loaded).mean((1, 2)) * CONE_WEIGHT
    weight = 1 / (truth.square().mean((1, 2, 3)) + LOSS_FLOOR)
    sums = truth.sum((2, 3))
    total = (predicted.sum((2, 3)) - sums).square().sum(1) / (sums.square().sum(1) + TOTAL_FLOOR)
    return ((shear + normal + cones) * weight + total * TOTAL_WEIGHT).mean()


def rate_at(progress):
    """One cycle, in shares of the peak."""

    def ease(start, end, t):
        return end + (start - end) * (1 + math.cos(math.pi * t)) / 2

    return ease(1 / 25, 1, progress / WARM_UP) if progress < WARM_UP else ease(1, 0.01, (progress - WARM_UP) / (1 - WARM_UP))


def metadata_of(path):
    """The text beside the tensors of a weights file."""
    head = path.read_bytes()
    (length,) = struct.unpack("<Q", head[:8])
    return json.loads(head[8 : 8 + length])["__metadata__"]


def weights_file(tensors, metadata):
    """The bytes of a weights file, with its check sum."""

    def data(file):
        return file[8 + struct.unpack("<Q", file[:8])[0] :]

    crc = 0
    for key in sorted(metadata):
        crc = zlib.crc32(f"{key}={metadata[key]}\n".encode(), crc)
    crc = zlib.crc32(data(save(tensors, metadata)), crc)
    return save(tensors, metadata | {"crc32": f"{crc:08x}"})


def main():
    here = Path(__file__).parent
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, default=here / "../data", help="folder of `gripline-training generate`")
    parser.add_argument("--like", type=Path, default=here / "../../network/weights/tracked.safetensors", help="weights whose scaling to take")
    parser.add_argument("--widths", default="16,48,64", help="channels at 20x20, 10x10 and 5x5, multiples of 8")
    parser.add_argument("--steps", type=int, default=37_500, help=f"gradient steps, of {BATCH} samples")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, required=True, help="weights file to write")
    options = parser.parse_args()

    torch.manual_seed(options.seed)
    metadata = metadata_of(options.like)
    scaling = {key: float(metadata[key]) for key in ("least_motion_mm", "usual_motion_mm", "newtons_per_mm")}
    train, validation = samples_of(options.data, "train"), samples_of(options.data, "validation")
    net = TrackedNet([int(width) for width in options.widths.split(",")])
    optimizer = torch.optim.AdamW(net.parameters(), lr=RATE, weight_decay=WEIGHT_DECAY)

    def loss_of(samples, chosen):
        x, scale = inputs(samples[0][chosen], scaling)
        return loss(net(x) * scale, samples[1][chosen])

    start = time.monotonic()
    order = torch.empty(0, dtype=torch.long)
    for step in range(options.steps):
        if len(order) < BATCH:
            order = torch.randperm(len(train[0]))
        chosen, order = order[:BATCH], order[BATCH:]
        for group in optimizer.param_groups:
            group["lr"] = RATE * rate_at(step / options.steps)
        now = loss_of(train, chosen)
        optimizer.zero_grad()
        now.backward()
        optimizer.step()
        if (step + 1) % max(1, options.steps // 40) == 0:
            net.eval()
            with torch.no_grad():
                losses = [loss_of(validation, chosen).item() for chosen in torch.arange(len(validation[0])).split(250)]
            net.train()
            minutes = (time.monotonic() - start) / 60
            print(f"{minutes:6.1f} min {(step + 1) * BATCH:8} sample-steps, validation loss {sum(losses) / len(losses):.4f}", flush=True)

    minutes = round((time.monotonic() - start) / 60)
    manifest = {"framework": f"PyTorch {torch.__version__}", "sample_steps": options.steps * BATCH, "minutes": minutes}
    metadata.pop("crc32")
    metadata |= {"manifest": json.dumps(manifest), "widths": options.widths}
    options.out.write_bytes(weights_file(net.tensors(), metadata))
    print(f"wrote {options.out}")


if __name__ == "__main__":
    main()
