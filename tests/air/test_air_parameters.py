"""The table of wanted parameters, and how it is judged."""

import pytest

from labr_autonomy.air.families import ARDUPILOT, PX4
from labr_autonomy.air.parameters import compare, refuse, wanted
from labr_autonomy.config import AirLimits
from labr_autonomy.errors import Refused
from sim.autopilot.copter.parameters import DEFAULTS as COPTER
from sim.autopilot.parameters import DEFAULTS as PX4_VALUES

LIMITS = AirLimits()
VALUES = {"PX4": dict(PX4_VALUES), "ArduPilot": {name: value for name, (value, _) in COPTER.items()}}
FAMILIES = pytest.mark.parametrize("family", [PX4, ARDUPILOT], ids=lambda f: f.name)


def reader(values):
    async def read(name, whole):
        return values.get(name)

    return read


@FAMILIES
async def test_the_reference_flights_parameters_fit(family):
    rows = await compare(wanted(family, LIMITS), reader(VALUES[family.name]))
    refuse(rows)
    assert {row.state for row in rows} <= {"good", "advice"}


@FAMILIES
async def test_each_parameter_that_must_be_right_refuses_when_it_is_not_and_when_it_is_not_there(family):
    for want in wanted(family, LIMITS):
        values = dict(VALUES[family.name])
        values[want.names[0]] = want.high + 77.0
        (row,) = await compare([want], reader(values))
        unbounded = want.high == float("inf")
        assert row.refuses is (want.must and not unbounded), want.names
        del values[want.names[0]]
        (row,) = await compare([want], reader(values))
        assert row.have is None
        assert row.refuses is want.must
        if want.must:
            with pytest.raises(Refused, match=f"{want.names[0]} is not there, wanted"):
                refuse([row])


@FAMILIES
def test_what_is_applied_is_what_is_wanted_and_each_row_says_why(family):
    for want in wanted(family, LIMITS):
        assert want.good(want.set_to)
        assert len(want.why) > 10


async def test_an_earlier_releases_name_will_do():
    values = {**VALUES["ArduPilot"], "SYSID_THISMAV": 1}
    del values["MAV_SYSID"]
    rows = await compare(wanted(ARDUPILOT, LIMITS), reader(values))
    assert next(r for r in rows if "SYS" in r.name).name == "SYSID_THISMAV"
    refuse(rows)


async def test_tighter_limits_of_the_autopilot_are_advice():
    values = {**VALUES["PX4"], "MPC_XY_VEL_MAX": 0.5}
    rows = await compare(wanted(PX4, LIMITS), reader(values))
    (row,) = [r for r in rows if r.state == "advice" and r.name.startswith("MPC")]
    assert (row.have, row.want) == (0.5, "at least 1.2")
    refuse(rows)
