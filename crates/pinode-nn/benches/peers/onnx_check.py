"""Holds an exported network beside onnxruntime: onnx_check.py WEIGHTS.safetensors FILE.onnx [COUNT].

Checks the file (`onnx.checker`, with shapes), computes COUNT (1000) random states, half of them within the ranges that the network was trained on and
half up to three times as wide, by onnxruntime and by numpy in 64 bits from the weights, and prints one line of JSON: the largest deviation of a
force as a share of its scale, in one batch and state after state. Ends with 1 when that is more than 1e-6 of 32 bits or 1e-12 of 64 bits.
Needs `pip install onnx onnxruntime numpy`.
"""
import json
import struct
import sys

import numpy
import onnx
import onnxruntime

weights, path = sys.argv[1:3]
COUNT = int(sys.argv[3]) if len(sys.argv) > 3 else 1000

# safetensors: the length of the header, the header, the numbers.
with open(weights, "rb") as file:
    header = json.loads(file.read(struct.unpack("<Q", file.read(8))[0]))
    numbers = file.read()
card = json.loads(header.pop("__metadata__")["pinode"])


def tensor(name):
    first, last = header[name]["data_offsets"]
    kind = {"F32": "<f4", "F64": "<f8"}[header[name]["dtype"]]
    return numpy.frombuffer(numbers[first:last], kind).reshape(header[name]["shape"]).astype(float)


layers = [(tensor(f"layers.{k}.weight"), tensor(f"layers.{k}.bias")) for k in range(sum(n.endswith(".bias") for n in header))]
ACTIVATIONS = {"relu": lambda z: numpy.maximum(z, 0), "tanh": numpy.tanh, "identity": lambda z: z}
offset, width = (numpy.array([feature[key] for feature in card["features"]]) for key in ("offset", "width"))
scale = numpy.array([joint["scale"] for joint in card["joints"]])


def force(x):
    y = (x - offset) / width
    for k, (w, b) in enumerate(layers):
        y = ACTIVATIONS[card["output" if k + 1 == len(layers) else "hidden"]](y @ w.T + b)
    return scale * y


model = onnx.load(path)
onnx.checker.check_model(model, full_check=True)
metadata = {entry.key: entry.value for entry in model.metadata_props}
assert [column["name"] for column in json.loads(metadata["pinode.features"])] == [f["name"] for f in card["features"]]
assert [column["name"] for column in json.loads(metadata["pinode.forces"])] == [j["name"] for j in card["joints"]]

session = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])
kind = {"tensor(float)": numpy.float32, "tensor(double)": numpy.float64}[session.get_inputs()[0].type]
low, high = numpy.array([feature["range"] for feature in card["features"]]).T
random = numpy.random.default_rng(1)
middle, half = (low + high) / 2, (high - low) / 2
wide = numpy.where(numpy.arange(COUNT) % 2, 1, 3)[:, None]
states = (middle + wide * half * random.uniform(-1, 1, (COUNT, len(low)))).astype(kind)
expected = force(states.astype(float))
(batch,) = session.run(["forces"], {"features": states})
single = numpy.concatenate([session.run(["forces"], {"features": row[None]})[0] for row in states])
deviation = max(float(numpy.max(numpy.abs(found - expected) / numpy.abs(scale))) for found in (batch, single))
print(json.dumps({"onnxruntime": onnxruntime.__version__, "precision": kind.__name__, "states": COUNT, "deviation": deviation}))
sys.exit(deviation > (1e-6 if kind is numpy.float32 else 1e-12))
