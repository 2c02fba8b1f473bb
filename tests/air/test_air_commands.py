from __future__ import annotations

import asyncio

import pytest

from labr_autonomy.air import commands as module
from labr_autonomy.air.commands import SENDS, Commands
from labr_autonomy.errors import LinkError


@pytest.fixture(autouse=True)
def _fast(monkeypatch):
    monkeypatch.setattr(module, "REPEAT_S", 0.01)
    monkeypatch.setattr(module, "PROGRESS_S", 0.05)


class Wire:
    """Takes what is sent and answers each command from a list of results; None is silence."""

    def __init__(self, *answers):
        self.answers = list(answers)
        self.sent = []
        self.commands = Commands(self.send, 1)

    def send(self, name, fields):
        assert name == "COMMAND_LONG"
        self.sent.append(fields)
        answer = self.answers.pop(0) if self.answers else None
        if answer is not None:
            command, result = answer
            asyncio.get_running_loop().call_soon(
                self.commands.take_ack, {"command": command, "result": result}
            )


async def test_parameters_not_given_are_zero_and_the_result_comes_back():
    wire = Wire((400, 2))
    assert await wire.commands.run("arm", 400, 1.0) == 2
    assert [wire.sent[0][f"param{i}"] for i in range(1, 8)] == [1.0, 0, 0, 0, 0, 0, 0]
    assert (wire.sent[0]["target_system"], wire.sent[0]["target_component"]) == (1, 1)


async def test_lost_frames_are_made_good_by_repeats():
    wire = Wire(None, None, (400, 0))
    assert await wire.commands.run("arm", 400, 1.0) == 0
    assert [f["confirmation"] for f in wire.sent] == [0, 1, 2]


async def test_an_acknowledgement_of_another_command_counts_for_nothing():
    wire = Wire(*[(21, 0)] * SENDS)
    with pytest.raises(LinkError, match="did not acknowledge the request to arm, sent 5 times"):
        await wire.commands.run("arm", 400, 1.0)


async def test_work_in_progress_stops_the_repeats_and_waits_on():
    wire = Wire((400, 5))
    task = asyncio.create_task(wire.commands.run("arm", 400, 1.0))
    asyncio.get_running_loop().call_later(0.03, wire.commands.take_ack, {"command": 400, "result": 0})
    assert await task == 0
    assert len(wire.sent) == 1


async def test_work_in_progress_that_never_ends_is_given_up():
    wire = Wire((400, 5))
    with pytest.raises(LinkError, match="did not acknowledge"):
        await wire.commands.run("arm", 400, 1.0)
    assert len(wire.sent) == 1


async def test_an_acknowledgement_nobody_waits_for_is_harmless():
    Wire().commands.take_ack({"command": 400, "result": 0})


async def test_the_latest_request_wins():
    wire = Wire()
    first = asyncio.create_task(wire.commands.run("arm", 400, 1.0))
    await asyncio.wait([first], timeout=0.005)
    wire.answers = [(21, 0)]
    assert await wire.commands.run("land", 21) == 0
    with pytest.raises(LinkError, match="the request to arm was overtaken by the request to land"):
        await first
    assert [f["command"] for f in wire.sent][-1] == 21
