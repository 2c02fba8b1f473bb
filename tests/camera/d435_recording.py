"""Depth images of a RealSense recording (rosbag v1): just enough of the format for its raw 16-bit images."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

_MESSAGE, _CHUNK, _CONNECTION = 2, 5, 7


def depth_images_m(path: Path) -> list[np.ndarray]:
    """Every image (h, w) of the topic Depth_0 in metres; the unit is 1 mm."""
    raw = path.read_bytes()
    images, topics = [], {}
    for header, data in _records(raw, raw.index(b"\n") + 1):
        if header["op"][0] != _CHUNK:
            continue
        content = _lz4_frame(data) if header["compression"] == b"lz4" else data
        for inner, body in _records(content, 0):
            if inner["op"][0] == _CONNECTION:
                topics[inner["conn"]] = inner["topic"].decode()
            elif inner["op"][0] == _MESSAGE and topics[inner["conn"]].endswith("Depth_0/image/data"):
                images.append(_image(body))
    return images


def _records(raw, at):
    while at < len(raw):
        (size,) = struct.unpack_from("<I", raw, at)
        header, field = {}, at + 4
        while field < at + 4 + size:
            (length,) = struct.unpack_from("<I", raw, field)
            name, _, value = raw[field + 4 : field + 4 + length].partition(b"=")
            header[name.decode()] = value
            field += 4 + length
        (length,) = struct.unpack_from("<I", raw, field)
        yield header, raw[field + 4 : field + 4 + length]
        at = field + 4 + length


def _image(body):
    """sensor_msgs/Image: sequence, stamp, frame, height, width, encoding, endianness, step, data."""
    (text,) = struct.unpack_from("<I", body, 12)
    height, width, text2 = struct.unpack_from("<III", body, 16 + text)
    data = 28 + text + text2 + 1 + 4 + 4
    return np.frombuffer(body, "<u2", height * width, data).reshape(height, width) * np.float32(1e-3)


def _lz4_frame(raw):
    flags = raw[4]
    at = 7 + (8 if flags & 0x08 else 0)
    out = bytearray()
    while True:
        (size,) = struct.unpack_from("<I", raw, at)
        at += 4
        if size == 0:
            return bytes(out)
        length = size & 0x7FFFFFFF
        block = raw[at : at + length]
        if size >> 31:
            out += block
        else:
            _lz4_block(block, out)
        at += length + (4 if flags & 0x10 else 0)


def _lz4_block(block, out):
    at = 0
    while True:
        token = block[at]
        at += 1
        count = token >> 4
        if count == 15:
            more, at = _extra(block, at)
            count += more
        out += block[at : at + count]
        at += count
        if at >= len(block):
            return
        back = block[at] | block[at + 1] << 8
        at += 2
        count = (token & 15) + 4
        if token & 15 == 15:
            more, at = _extra(block, at)
            count += more
        start = len(out) - back
        if back >= count:
            out += out[start : start + count]
        else:
            seed = bytes(out[start:])
            out += (seed * (count // back + 1))[:count]


def _extra(block, at):
    total = 0
    while True:
        total += block[at]
        at += 1
        if block[at - 1] != 255:
            return total, at
