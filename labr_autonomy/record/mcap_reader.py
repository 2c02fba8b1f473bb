"""Reads MCAP files, also torn ones: up to the last chunk that is whole."""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from mcap.exceptions import McapError
from mcap.records import Channel, McapRecord, Message
from mcap.stream_reader import StreamReader
from zstandard import ZstdError  # mcap's own compression

from labr_autonomy.errors import BadInput

RECORD_MAX_BYTES = 64 * 1024 * 1024


def read_log(path: Path) -> Iterator[tuple[str, dict[str, Any]]]:
    """JSON messages (topic, body) in the order written, up to the end or to where the file is torn.

    Raises:
        BadInput: when it is no MCAP file at all.
    """
    for topic, encoding, data in read_raw(path):
        if encoding == "json":
            yield topic, json.loads(data)


def read_raw(path: Path) -> Iterator[tuple[str, str, bytes]]:
    """Messages (topic, encoding, bytes) in the order written, up to the end or to where the file is torn.

    Raises:
        BadInput: when it is no MCAP file at all.
    """
    channels: dict[int, Channel] = {}
    for record in records_of(path):
        if isinstance(record, Channel):
            channels[record.id] = record
        elif isinstance(record, Message) and record.channel_id in channels:
            channel = channels[record.channel_id]
            yield channel.topic, channel.message_encoding, record.data


def records_of(path: Path) -> Iterator[McapRecord]:
    """All records, up to the end or to where the file is torn.

    Raises:
        BadInput: when it is no MCAP file at all.
    """
    try:
        stream = path.open("rb")
    except OSError as error:
        raise BadInput(f"{path} cannot be read: {error.strerror}", "Check the path") from None
    with stream:
        records = StreamReader(stream, record_size_limit=RECORD_MAX_BYTES).records
        any_read = False
        while True:
            try:
                record = next(records, None)
            except (McapError, ZstdError, struct.error, ValueError, EOFError) as error:
                if not any_read:
                    raise BadInput(f"{path} is not an MCAP file", "Name a flight.mcap of a run") from error
                return  # torn: the process was killed while writing
            if record is None:
                return
            any_read = True
            yield record
