"""The land controller's codes in an operator's words."""

from __future__ import annotations

from firmware_bridge.dialect import labr_land as wire

MODES = {
    wire.LAND_MODE_WAITING: "waiting",
    wire.LAND_MODE_IDLE: "idle",
    wire.LAND_MODE_ENGAGED: "engaged",
    wire.LAND_MODE_AIR: "air lock",
    wire.LAND_MODE_ESTOP: "emergency stop",
}

FAULTS = {
    wire.LAND_FAULT_COMMAND_TIMEOUT: "no command for 200 ms",
    wire.LAND_FAULT_COMMAND_REFUSED: "command refused",
    wire.LAND_FAULT_HEARTBEAT_LOST: "computer fell silent",
    wire.LAND_FAULT_WHEEL_STALL: "wheel stalled",
    wire.LAND_FAULT_WHEEL_RUNAWAY: "wheel races",
    wire.LAND_FAULT_OVERCURRENT: "drive current too high",
    wire.LAND_FAULT_BATTERY_LOW: "battery low",
    wire.LAND_FAULT_ESTOP: "emergency stop",
    wire.LAND_FAULT_DRIVER: "motor driver fault",
}

LATCHED = frozenset(  # until the computer lets go
    FAULTS[fault]
    for fault in (
        wire.LAND_FAULT_WHEEL_STALL,
        wire.LAND_FAULT_WHEEL_RUNAWAY,
        wire.LAND_FAULT_OVERCURRENT,
        wire.LAND_FAULT_DRIVER,
    )
)

RESULTS = {
    wire.LAND_RESULT_OK: "accepted",
    wire.LAND_RESULT_SESSION: "the session is not the open one",
    wire.LAND_RESULT_RANGE: "the value is outside the limits",
    wire.LAND_RESULT_SEQUENCE: "the sequence number is old",
    wire.LAND_RESULT_LATE: "it came after its deadline",
    wire.LAND_RESULT_ESTOP: "the emergency stop is latched",
    wire.LAND_RESULT_ENGAGE: "a disengaged command must come first",
    wire.LAND_RESULT_HEARTBEAT: "the computer's heartbeat was missing",
    wire.LAND_RESULT_AIR: "the air lock is set",
    wire.LAND_RESULT_LOAD: "the wheels carry no load",
    wire.LAND_RESULT_ROTORS: "the rotors have power",
    wire.LAND_RESULT_UNKNOWN: "there is no such parameter, step or token",
    wire.LAND_RESULT_BUSY: "that needs a disengaged controller",
}


def mode_word(mode: int) -> str:
    """Word for a LAND_MODE."""
    return MODES.get(mode, f"mode {mode}")


def result_words(result: int) -> str:
    """Words for a LAND_RESULT."""
    return RESULTS.get(result, f"result {result}")


def fault_words(faults: int, last_result: int) -> tuple[str, ...]:
    """Words for each LAND_FAULT bit; a refused command names its reason."""
    words: list[str] = []
    for bit in range(16):
        fault = 1 << bit
        if not faults & fault:
            continue
        word = FAULTS.get(fault, f"fault bit {bit}")
        if fault == wire.LAND_FAULT_COMMAND_REFUSED:
            word = f"{word}: {result_words(last_result)}"
        words.append(word)
    return tuple(words)
