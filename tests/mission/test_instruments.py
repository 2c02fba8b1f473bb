"""What the pilot is told of the links' own words."""

from types import SimpleNamespace

import pytest

from firmware_bridge.dialect import labr_land as wire
from labr_autonomy.air.telemetry import AirState
from labr_autonomy.config import RobotConfig
from labr_autonomy.ground.state import Telemetry, describe
from labr_autonomy.guard.failsafe import Reaction, State, step
from labr_autonomy.mission.instruments import look
from labr_autonomy.mission.pilot_io import Order
from labr_autonomy.mission.watchers import Watchers
from labr_autonomy.modes import transition
from labr_autonomy.types import Mode

AIR = AirState(1.0, True, False, "hold", "on_ground", None, None, None, 20.5, 0.9, 1.0, 0.1, False)


def seen(land_mode: int):
    """A look at a robot on its wheels whose land controller is in `land_mode`."""
    names = wire.MAVLink_land_state_message.fieldnames
    message = wire.MAVLink_land_state_message(**{name: land_mode * (name == "mode") for name in names})
    pilot = SimpleNamespace(
        depth_fault="",
        mode=Mode.LAND,
        planning_mode=None,
        landing_asked=False,
        transition=transition.State(),
    )
    poses = SimpleNamespace(
        ages=lambda _: {"vio_accepted": 0.02}, predicted=lambda _: None, vio_rejected_in_a_row=0
    )
    return look(
        pilot,
        Watchers(),
        RobotConfig(),
        poses,
        describe(Telemetry(1.0, 1.0, message), True, "", 1.02),
        AIR,
        depth_stamp_s=1.0,
        plan_age_s=0.0,
        order=Order.FLY,
        now_s=1.02,
    )


@pytest.mark.parametrize("land_mode", [m for m in wire.enums["LAND_MODE"] if m != wire.LAND_MODE_ENUM_END])
def test_the_land_controllers_emergency_stop_holds_the_robot_and_no_other_mode_does(land_mode):
    latched = land_mode == wire.LAND_MODE_ESTOP
    health = seen(land_mode).health
    assert health.estop is latched
    state = step(State(), health, 1.02)
    assert (state.reaction, state.code) == ((Reaction.HOLD, "estop") if latched else (Reaction.NONE, ""))
