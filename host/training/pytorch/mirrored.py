"""Layers that compute the same in the eight mirrors of the square, as `src/mirrored.rs` has them.

Weights that a symmetry moves onto each other are one parameter, so a layer has an eighth of the parameters of an ordinary
convolution, whose weights `Mirrored.weights` gives.
"""

import torch
from torch import nn
from torch.nn import functional

# The symmetries in the order of `Symmetry::ALL`: bit 0 mirrors x, bit 1 mirrors y, bit 2 exchanges them at last.
SYMMETRIES = torch.stack(
    [
        (torch.tensor([[0, 1], [1, 0]]) if i & 4 else torch.eye(2, dtype=torch.long))
        @ torch.diag(torch.tensor([-1 if i & 1 else 1, -1 if i & 2 else 1]))
        for i in range(8)
    ]
)


def _index(symmetry):
    return next(i for i in range(8) if torch.equal(SYMMETRIES[i], symmetry))


# What the second symmetry does after the first is what this one does: `AFTER[second][first]`.
AFTER = [[_index(second @ first) for first in SYMMETRIES] for second in SYMMETRIES]

CHANNELS = {"scalar": 1, "vector": 2, "regular": 8}


def regular(channels):
    """The fields of a layer's hidden channels."""
    return ["regular"] * (channels // 8)


def _moved(fields, symmetry):
    """Where a symmetry (an index) moves each channel of these fields, and the sign that it gets."""
    to, signs = [], []
    for field in fields:
        first = len(to)
        if field == "scalar":
            to.append(first)
            signs.append(1.0)
        elif field == "vector":
            for column in range(2):
                row = int(SYMMETRIES[symmetry][:, column].nonzero())
                to.append(first + row)
                signs.append(float(SYMMETRIES[symmetry][row, column]))
        else:
            to.extend(first + AFTER[symmetry][element] for element in range(8))
            signs.extend([1.0] * 8)
    return torch.tensor(to), torch.tensor(signs)


class _Spread(torch.autograd.Function):
    """All weights from the free ones: `free` [n], `signs` and `moved_to` [8, n], `origin` the inverse of `moved_to`."""

    @staticmethod
    def forward(context, free, signs, moved_to, origin):
        context.save_for_backward(signs, moved_to)
        return (free * signs).flatten()[origin]

    @staticmethod
    def backward(context, gradient):
        signs, moved_to = context.saved_tensors
        return (gradient[moved_to] * signs).sum(0), None, None, None


class Mirrored(nn.Module):
    """The weights of a layer between these fields, with `size` taps along a side."""

    def __init__(self, fields_in, fields_out, size):
        super().__init__()
        count_in, count_out = (sum(CHANNELS[field] for field in fields) for fields in (fields_in, fields_out))
        self.shape = (count_out, count_in, size, size)
        grids = torch.meshgrid(*(torch.arange(n) for n in self.shape), indexing="ij")
        channel_out, channel_in, row, column = (grid.flatten() for grid in grids)
        point = torch.stack([column, row]) - (size - 1) / 2
        moved_to, signs = [], []
        for symmetry in range(8):
            (to_out, sign_out), (to_in, sign_in) = (_moved(fields, symmetry) for fields in (fields_out, fields_in))
            x, y = (SYMMETRIES[symmetry].float() @ point + (size - 1) / 2).round().long()
            moved_to.append(((to_out[channel_out] * count_in + to_in[channel_in]) * size + y) * size + x)
            signs.append(sign_out[channel_out] * sign_in[channel_in])
        moved_to, signs = torch.stack(moved_to), torch.stack(signs)
        # No symmetry leaves a weight where it is, because one side of every layer is regular: orbits have eight weights.
        firsts = moved_to.min(0).values == torch.arange(moved_to.shape[1])
        moved_to, signs = moved_to[:, firsts].contiguous(), signs[:, firsts].contiguous()
        self.register_buffer("moved_to", moved_to, False)
        self.register_buffer("origin", torch.argsort(moved_to.flatten()), False)
        self.register_buffer("signs", signs, False)
        bound = (count_in * size * size) ** -0.5
        self.free = nn.Parameter(torch.empty(moved_to.shape[1]).uniform_(-bound, bound))

    def weights(self):
        """Those of an ordinary convolution, [out, in, size, size]."""
        return _Spread.apply(self.free, self.signs, self.moved_to, self.origin).view(self.shape)


class Stage(nn.Module):
    """A convolution with batch norm, over a field's channels together, and ReLU; `halves` or `doubles` the picture or neither."""

    def __init__(self, fields_in, channels, kind="same"):
        super().__init__()
        self.kind = kind
        self.convolution = Mirrored(fields_in, regular(channels), 3 if kind == "same" else 4)
        self.norm = nn.BatchNorm1d(channels // 8)

    def forward(self, x):
        weights = self.convolution.weights()
        if self.kind == "doubles":
            weights = weights.transpose(0, 1).contiguous(memory_format=torch.channels_last)
            x = functional.conv_transpose2d(x, weights, stride=2, padding=1)
        else:
            weights = weights.contiguous(memory_format=torch.channels_last)
            x = functional.conv2d(x, weights, stride=2 if self.kind == "halves" else 1, padding=1)
        batch, channels, height, width = x.shape
        x = x.permute(0, 2, 3, 1).reshape(-1, channels // 8, 8)
        return functional.relu(self.norm(x)).view(batch, height, width, channels).permute(0, 3, 1, 2)


class TrackedNet(nn.Module):
    """The network after the tracker: [batch, 10, 40, 40] to [batch, 3, 20, 20], in the network's units."""

    # Motion and confidence of near and far particles, the node's position and squared distance, the motion's log.
    INPUT = ["vector", "scalar", "vector", "scalar", "vector", "scalar", "scalar"]

    def __init__(self, widths):
        super().__init__()
        a, b, c = widths
        stages = {
            "encode20a": (self.INPUT, a, "halves"),
            "encode20b": (regular(a), a, "same"),
            "encode10a": (regular(a), b, "halves"),
            "encode10b": (regular(b), b, "same"),
            "bottom5a": (regular(b), c, "halves"),
            "bottom5b": (regular(c), c, "same"),
            "up10": (regular(c), b, "doubles"),
            "decode10": (regular(2 * b), b, "same"),
            "up20": (regular(b), a, "doubles"),
            "decode20": (regular(2 * a), a, "same"),
        }
        self.stages = nn.ModuleDict({name: Stage(*of) for name, of in stages.items()})
        self.output = Mirrored(regular(a), ["vector", "scalar"], 3)
        # No shear stays as it is in every mirror, so the normal force alone has a bias.
        self.bias = nn.Parameter(torch.zeros(1))

    def forward(self, x):
        stage = self.stages
        at20 = stage["encode20b"](stage["encode20a"](x))
        at10 = stage["encode10b"](stage["encode10a"](at20))
        at5 = stage["bottom5b"](stage["bottom5a"](at10))
        at10 = stage["decode10"](torch.cat([stage["up10"](at5), at10], 1))
        at20 = stage["decode20"](torch.cat([stage["up20"](at10), at20], 1))
        bias = functional.pad(self.bias, (2, 0))
        return functional.conv2d(at20, self.output.weights(), bias, padding=1)

    def tensors(self):
        """Those of the weights file, by name."""
        tensors = {"output.weight": self.output.weights(), "output.bias": functional.pad(self.bias, (2, 0))}
        for name, stage in self.stages.items():
            weights = stage.convolution.weights()
            tensors[f"{name}.weight"] = weights.transpose(0, 1) if stage.kind == "doubles" else weights
            norm = stage.norm
            parts = {"gamma": norm.weight, "beta": norm.bias, "mean": norm.running_mean, "variance": norm.running_var}
            tensors |= {f"{name}.norm.{part}": of.repeat_interleave(8) for part, of in parts.items()}
        return {name: tensor.detach().contiguous().numpy() for name, tensor in tensors.items()}
