#!/usr/bin/env python3
"""Writes the logs of this folder with other people's writers: the same recording as CSV, Parquet and MCAP.

pip install pyarrow mcap mcap-ros2-support; then run it in this folder.
"""
import csv
import decimal
import json
import math

import pyarrow as pa
import pyarrow.parquet as pq
from mcap.writer import CompressionType, Writer
from mcap_ros2.writer import Writer as RosWriter

ROWS = 80
STEP = 20_000_000  # ns
START = 1_700_000_000_123_456_789  # ns
SIGNALS = ["q.slider", "q.pole", "v.slider", "v.pole", "u.motor"]


def table():
    """Time in s and the signals, at numbers that CSV keeps."""
    columns = {"t": []} | {name: [] for name in SIGNALS}
    for i in range(ROWS):
        t = i * STEP / 1e9
        values = [0.1 * math.sin(2.1 * t), 0.3 * math.cos(3.7 * t), 0.21 * math.cos(2.1 * t), -1.11 * math.sin(3.7 * t)]
        for name, value in zip(SIGNALS, values + [2 * math.sin(5 * t)]):
            columns[name].append(round(value, 6))
        columns["t"].append(t)
    return columns


def write_csv(name, columns):
    with open(name, "w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(zip(*columns.values()))


def parquet(columns):
    write = lambda name, **options: pq.write_table(pa.table(columns), name, **options)
    write("snappy.parquet", compression="snappy")
    write("zstd.parquet", compression="zstd", row_group_size=30, data_page_version="2.0", data_page_size=100)
    write("gzip.parquet", compression="gzip", use_dictionary=False)
    write("lz4.parquet", compression="lz4", use_dictionary=False, use_byte_stream_split=True)
    write("plain.parquet", compression="none", use_dictionary=False)
    write("brotli.parquet", compression="brotli")
    faulty = {name: list(values) for name, values in columns.items()}
    faulty["q.slider"][11] = None
    faulty["q.pole"][19] = math.nan
    pq.write_table(pa.table(faulty), "faulty.parquet")


def types(columns):
    """Columns of many types, and the same numbers as CSV: counts of a counter, stamps, ids."""
    plain = {
        "t": columns["t"],
        "q.slider": [round(1e4 * x) for x in columns["q.slider"]],
        "q.pole": [round(x, 4) for x in columns["q.pole"]],
        "v.slider": [round(64 * x) / 64 for x in columns["v.slider"]],
        "v.pole": [4_000_000_000 + i for i in range(ROWS)],
        "u.motor": [int(u > 0) for u in columns["u.motor"]],
        "run": [7_000_000_000_000_000_001 + i // 40 for i in range(ROWS)],
    }
    write_csv("types.csv", plain)
    arrays = {
        "t": pa.array([START + i * STEP for i in range(ROWS)], pa.timestamp("ns", "UTC")),
        "q.slider": pa.array(plain["q.slider"], pa.int16()),
        "q.pole": pa.array([decimal.Decimal(f"{x:.4f}") for x in plain["q.pole"]], pa.decimal128(9, 4)),
        "v.slider": pa.array(plain["v.slider"], pa.float32()),
        "v.pole": pa.array(plain["v.pole"], pa.uint32()),
        "u.motor": pa.array([bool(u) for u in plain["u.motor"]]),
        "run": pa.array(plain["run"], pa.int64()),
        "forces": pa.array([[1.0] * (i % 3) for i in range(ROWS)], pa.list_(pa.float64())),
    }
    pq.write_table(pa.table(arrays), "types.parquet", row_group_size=50)
    joint = pa.StructArray.from_arrays([arrays["q.slider"], arrays["q.pole"]], ["slider", "pole"])
    words = pa.array([str(u) for u in plain["u.motor"]]).dictionary_encode()
    others = {"q": joint, "u.motor": words, "t": arrays["t"].cast(pa.timestamp("us"), safe=False)}
    pq.write_table(pa.table(arrays | others).drop(["q.slider", "q.pole"]), "nested.parquet")


def stamp(ns):
    return {"sec": ns // 10**9, "nanosec": ns % 10**9}


SEPARATOR = "\n" + 80 * "=" + "\n"
HEADER = f"""{SEPARATOR}MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id{SEPARATOR}MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec"""
JOINT_STATE = """# The state of some joints.
std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort""" + HEADER
# Everything that a definition may have.
STATUS = f"""uint8 READY=1   # a constant
string NAME="a # b"
bool ready
string<=8 label
float32[3] gains
int16[<=5] counts
rig_msgs/Part[] parts
Part main
int8 tiny
float64 force{SEPARATOR}MSG: rig_msgs/Part
string name "none"
uint16 code 3
int64 serial"""


def ros(columns):
    """Joint states whose joints change their order, commands just before them, and a message with everything."""
    with open("ros2.mcap", "wb") as file:
        writer = RosWriter(file, chunk_size=4000, compression=CompressionType.LZ4)
        joints = writer.register_msgdef("sensor_msgs/msg/JointState", JOINT_STATE)
        command = writer.register_msgdef("std_msgs/msg/Float64", "float64 data")
        status = writer.register_msgdef("rig_msgs/msg/Status", STATUS)
        for i in range(ROWS):
            now = START + i * STEP
            names = ["slider", "pole"] if i % 2 else ["pole", "slider"]
            of = lambda signal: [columns[f"{signal}.{name}"][i] for name in names]
            force = columns["u.motor"][i]
            part = lambda code: {"name": "x" * (code % 4), "code": code, "serial": -code}
            everything = {
                "ready": True, "label": "y" * (i % 5), "gains": [1.0, 2.0, 3.0], "counts": list(range(i % 4)),
                "parts": [part(i)] * (i % 3), "main": part(i), "tiny": -1, "force": force,
            }
            state = {
                "header": {"stamp": stamp(now), "frame_id": "w" * (i % 7)}, "name": names,
                "position": of("q"), "velocity": of("v"), "effort": [math.nan, math.nan],
            }
            writer.write_message("/motor/command", command, {"data": force}, log_time=now - 2_000_000)
            writer.write_message("/status", status, everything, log_time=now - 1_000_000)
            writer.write_message("/joint_states", joints, state, log_time=now + 1_000_000)
        writer.finish()


def json_log(columns):
    """One topic with everything, and one that nobody here can read."""
    with open("json.mcap", "wb") as file:
        writer = Writer(file, compression=CompressionType.ZSTD)
        writer.start()
        rig = writer.register_channel("/rig", "json", writer.register_schema("rig", "jsonschema", b"{}"))
        odd = writer.register_channel("/odd", "protobuf", writer.register_schema("odd", "protobuf", b""))
        for i in range(ROWS):
            now = START + i * STEP
            message = {name: columns[name][i] for name in SIGNALS} | {"note": "calm", "temperature": 20}
            writer.add_message(rig, now, json.dumps(message).encode(), now)
            writer.add_message(odd, now, b"\0", now)
        writer.finish()


recording = table()
write_csv("rig.csv", recording)
parquet(recording)
types(recording)
ros(recording)
json_log(recording)
