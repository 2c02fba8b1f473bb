"""A hand-over in the simulator's physics, recorded as a flight is, with the true joules beside."""

from __future__ import annotations

from labr_autonomy.modes.transition import Phase
from labr_autonomy.record.flight_log import FlightLog
from sim.bench.transitions.trial import fly

EVERY = 5  # ticks between two entries: 10 Hz, as in flight


def recorded(seed, folder):
    """Fly the trial of a seed and leave folder/flight.mcap; returns the trial, its plant and mean watts."""
    folder.mkdir(parents=True, exist_ok=True)
    spent = {phase: [0.0, 0.0] for phase in Phase}  # joules, seconds
    kept = {}
    with FlightLog(folder / "flight.mcap", metadata={"mission": "hand-over"}) as log:

        def listen(flight):
            kept["plant"] = flight._plant
            measure, before = flight.on_tick, {"phase": None, "used": None, "tick": 0, "s": 0.0}

            def tick(now_s, actions):
                measure(now_s, actions)
                battery = flight._plant.battery
                if actions.phase is not before["phase"]:
                    log.mode(now_s, actions.mode.value, actions.phase.value, "")
                elif before["used"] is not None:
                    spent[actions.phase][0] += battery.used_j - before["used"]
                    spent[actions.phase][1] += now_s - before["s"]
                before.update(phase=actions.phase, used=battery.used_j, s=now_s, tick=before["tick"] + 1)
                estimate = flight._filter.predicted(now_s)
                if before["tick"] % EVERY == 0 and estimate is not None:
                    log.odometry(estimate)
                    log.battery(
                        now_s,
                        voltage_v=battery.volts,
                        power_w=battery.volts * battery.current_a,
                        energy_land_j=0.0,
                        energy_air_j=0.0,
                        energy_transition_j=0.0,
                    )

            flight.on_tick = tick

        hop = fly(seed, listen)
    return hop, kept["plant"], spent
