"""Logs that were cut off (power, a killed process) made whole again: everything before the tear is kept.

The logs close a chunk every half second and have it put on the disk, so a cut loses less than one second. The
torn file stays beside the repaired one as `*.torn`.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.records import Channel, Message, Metadata, Schema
from mcap.writer import Writer

from labr_autonomy.errors import BadInput
from labr_autonomy.record.mcap_reader import records_of


@dataclass(frozen=True, slots=True)
class Repaired:
    """What was done to one file."""

    name: str
    whole: bool  # it was whole already
    messages: int
    length_s: float  # from the first to the last message that is left

    @property
    def sentence(self) -> str:
        """As a sentence."""
        if self.whole:
            return f"{self.name}: whole, nothing to repair"
        if not self.messages:
            return f"{self.name}: nothing in it can be read; it is put aside as {self.name}.torn"
        kept = f"{self.messages} messages over {self.length_s:.1f} s"
        return f"{self.name}: repaired, {kept} kept; the torn file is {self.name}.torn"

    def as_dict(self) -> dict[str, Any]:
        """JSON-ready."""
        return {"file": self.name, "whole": self.whole, "messages": self.messages, "length_s": self.length_s}


def repair_run(run: Path) -> list[Repaired]:
    """Repair every MCAP file of a run.

    One that cannot be read at all, such as a log that was just opened when the power went, is put aside.

    Raises:
        BadInput: when there is none, or not one that can be read.
    """
    logs = sorted(run.glob("*.mcap"))
    if not logs:
        raise BadInput(f"{run} has no MCAP file", "Name the folder of a run")
    found, lost = [], []
    for path in logs:
        try:
            found.append(repair(path))
        except BadInput as error:
            lost.append((path, error))
    if not found:
        raise lost[0][1]
    return found + [put_aside(path) for path, _ in lost]


def put_aside(path: Path) -> Repaired:
    """Rename a file of which nothing can be read, so that the rest of the run can be used."""
    path.replace(path.with_name(f"{path.name}.torn"))
    return Repaired(path.name, False, 0, 0.0)


def repair(path: Path) -> Repaired:
    """Repair one file in place.

    Raises:
        BadInput: when not even its beginning is MCAP.
    """
    if is_whole(path):
        return Repaired(path.name, True, 0, 0.0)
    draft = path.with_suffix(".mcap.part")
    try:
        found = _copy(path, draft)
        path.replace(path.with_name(f"{path.name}.torn"))
        draft.replace(path)
    finally:
        draft.unlink(missing_ok=True)
    return found


def _copy(path: Path, draft: Path) -> Repaired:
    """Write what can be read of a torn file into a new one."""
    messages, first_ns, last_ns = 0, None, 0
    with draft.open("wb") as stream:
        writer = Writer(stream)
        writer.start(profile="", library="labr-autonomy")
        schemas: dict[int, int] = {0: 0}
        channels: dict[int, int] = {}
        for record in records_of(path):
            if isinstance(record, Schema):
                if record.id not in schemas:
                    schemas[record.id] = writer.register_schema(record.name, record.encoding, record.data)
            elif isinstance(record, Channel):
                if record.id not in channels:
                    schema = schemas[record.schema_id]
                    channels[record.id] = writer.register_channel(
                        record.topic, record.message_encoding, schema
                    )
            elif isinstance(record, Metadata):
                writer.add_metadata(record.name, dict(record.metadata))
            elif isinstance(record, Message) and record.channel_id in channels:
                channel = channels[record.channel_id]
                writer.add_message(
                    channel, record.log_time, record.data, record.publish_time, record.sequence
                )
                messages += 1
                if record.log_time > 0:  # 0 stands for a stamp that is not known
                    first_ns = record.log_time if first_ns is None else min(first_ns, record.log_time)
                    last_ns = max(last_ns, record.log_time)
        writer.finish()
    return Repaired(path.name, False, messages, (last_ns - first_ns) / 1e9 if first_ns is not None else 0.0)


def is_whole(path: Path) -> bool:
    """Whether a file has the summary that stands at the end of a finished one."""
    with path.open("rb") as stream:
        try:
            return make_reader(stream).get_summary() is not None and _ends_well(path)
        except (McapError, ValueError, EOFError):
            return False


def _ends_well(path: Path) -> bool:
    magic = b"\x89MCAP0\r\n"
    with path.open("rb") as stream:
        stream.seek(0, 2)
        if stream.tell() < 2 * len(magic):
            return False
        stream.seek(-len(magic), 2)
        return stream.read() == magic
