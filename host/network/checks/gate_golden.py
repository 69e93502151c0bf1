"""Runs the scene gate's model in LiteRT's interpreter and writes what it answers to golden/gate.safetensors.

`cargo xtask gate` calls it after training; by hand: `pip install ai-edge-litert==2.3.0 numpy`, then
`python3 host/network/checks/gate_golden.py`. Tensors: `inputs` and `outputs`, int8, n x 242 and n x 2 (touched, changed);
the metadata holds the model's CRC-32, so that a golden file of another model is noticed.
"""

import json
import pathlib
import struct
import zlib

import numpy
from ai_edge_litert.interpreter import Interpreter, OpResolverType

NETWORK = pathlib.Path(__file__).resolve().parent.parent
SEED = 20
RANDOM = 64


def inputs():
    """Pictures of noise, of touches of all sizes and strengths, and of numbers that no picture gives."""
    random = numpy.random.default_rng(SEED)
    rows, columns = numpy.mgrid[0:11, 0:11]
    for number in range(3 * RANDOM):
        energy = random.exponential(2.0, (11, 11, 2))
        if number % 3 == 1:
            for channel in range(2):
                row, column = random.uniform(0, 11, 2)
                away = ((rows - row) ** 2 + (columns - column) ** 2) / random.uniform(0.3, 12.0)
                energy[..., channel] += random.choice([0, 3, 10, 40, 300]) * numpy.exp(-away)
        steps = numpy.clip(numpy.floor(4.0 * energy + 0.5), 0, 255) - 128
        if number % 3 == 2:
            steps = random.integers(-128, 128, (11, 11, 2))
        yield steps.astype(numpy.int8)


def main():
    model = (NETWORK / "weights" / "gate.tflite").read_bytes()
    # The reference kernels: the optimised ones round otherwise in the last digit.
    interpreter = Interpreter(
        model_content=model,
        experimental_op_resolver_type=OpResolverType.BUILTIN_REF,
    )
    interpreter.allocate_tensors()
    [given] = interpreter.get_input_details()
    [answer] = interpreter.get_output_details()
    asked, answered = [], []
    for steps in inputs():
        interpreter.set_tensor(given["index"], steps[None])
        interpreter.invoke()
        asked.append(steps.reshape(-1))
        answered.append(interpreter.get_tensor(answer["index"]).reshape(-1))
    tensors = {"inputs": numpy.stack(asked), "outputs": numpy.stack(answered)}
    header = {"__metadata__": {"model_crc32": f"{zlib.crc32(model):08x}", "interpreter": "ai-edge-litert 2.3.0"}}
    data = b""
    for name, tensor in tensors.items():
        header[name] = {
            "dtype": "I8",
            "shape": list(tensor.shape),
            "data_offsets": [len(data), len(data) + tensor.nbytes],
        }
        data += tensor.tobytes()
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 8)
    path = NETWORK / "golden" / "gate.safetensors"
    path.write_bytes(struct.pack("<Q", len(text)) + text + data)
    print(f"{path.name}: {len(asked)} inputs, outputs between {answered_range(tensors['outputs'])}")


def answered_range(outputs):
    return ", ".join(f"{low} and {high}" for low, high in zip(outputs.min(0), outputs.max(0)))


if __name__ == "__main__":
    main()
