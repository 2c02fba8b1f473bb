"""Flies a trial from its description: world, physics, camera and method are made, used and judged here."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from labr_autonomy.clock import cpu_s
from labr_autonomy.config import RobotConfig
from sim.camera.process import Eye
from sim.camera.renderer import Renderer, make_renderer
from sim.disturbances import Disturbances
from sim.lockstep.flight import LockstepFlight, to_goal
from sim.lockstep.planner import Planner
from sim.lockstep.trial import REACHED_M, Outcome, Task, Trial, TrialResult
from sim.movers.crowd import Crowd
from sim.movers.mover import Mover
from sim.plant import Plant
from sim.vio import VioModel, VioStandIn
from sim.worlds.made import made_world

# What the filter makes of it is the truth to a millimetre; sigmas of nothing would be no measurement.
TRUE_POSE = VioModel(
    delay_s=0.0,
    position_sigma_m=1e-4,
    rotation_sigma_rad=1e-4,
    velocity_sigma_mps=1e-3,
    drift_share=0.0,
    yaw_drift_rad_per_m=0.0,
)


class Stage:
    """A world made ready to fly and look in; kept from trial to trial, because its renderer takes a while."""

    _last: Stage | None = None

    def __init__(self, key: str, spec: Mapping[str, Any], robot: RobotConfig) -> None:
        self._key = key
        self._robot = robot
        self.world, self.surface = made_world(spec, robot.body)
        self._renderer: Renderer | None = None

    @classmethod
    def of(cls, spec: Mapping[str, Any], robot: RobotConfig) -> Stage:
        """The stage of a world, made anew only when the last trial was in another one."""
        key = json.dumps([dict(spec), robot.model_dump(mode="json")], sort_keys=True)
        if cls._last is None or cls._last._key != key:
            if cls._last is not None:
                cls._last.close()
            cls._last = cls(key, spec, robot)
        return cls._last

    @property
    def renderer(self) -> Renderer:
        """The camera's renderer, made when first asked for."""
        if self._renderer is None:
            camera = self._robot.camera
            self._renderer = make_renderer(self.world, camera.intrinsics, camera.range_max_m)
        return self._renderer

    def close(self) -> None:
        """Give back what the renderer holds."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None


def fly_with(
    task: Task,
    planner: Planner,
    robot: RobotConfig,
    *,
    sees: bool = True,
    true_pose: bool = False,
    meets_movers: bool = True,
) -> TrialResult:
    """Fly a task with a planner.

    Args:
        task: What is asked.
        planner: The method, fresh.
        robot: The robot.
        sees: Render the camera's images for it.
        true_pose: Give it the true pose without noise, drift or delay (the oracle's privilege).
        meets_movers: The task's movers are there for it (the oracle flies without them).
    """
    stage = Stage.of(task.world, robot)
    disturbances = Disturbances.for_world(task.world)
    plant = Plant(robot, stage.surface, task.start, task.seed, disturbances)
    vio = VioStandIn(task.seed, TRUE_POSE if true_pose else disturbances.vio)
    eye = Eye(stage.renderer, robot.camera, seed=task.seed) if sees else None
    movers = [Mover.from_dict(values) for values in task.movers] if meets_movers else []
    crowd = Crowd(movers, robot) if movers else None
    goal = to_goal(task.goal_m, task.in_air)
    flight = LockstepFlight(robot, plant, vio, eye, planner, [goal], task.seed, crowd)
    began_s = cpu_s()
    outcome, reason = flight.run(task.limit_s)
    spent_s = cpu_s() - began_s
    there = plant.state.position_m
    error_m = float(np.linalg.norm(there - np.array(task.goal_m)))
    outcome, reason = _judged(outcome, reason, error_m)
    referee, record = flight.referee, flight.record
    return TrialResult(
        outcome=outcome,
        reason=reason,
        goal_error_m=error_m,
        time_s=flight.time_s,
        land_m=referee.land_m,
        air_m=referee.air_m,
        energy_land_j=record.joules.land,
        energy_air_j=record.joules.air,
        energy_transition_j=record.joules.transition,
        min_clearance_m=referee.min_clearance_m,
        touchdown_mps=referee.touchdown_mps,
        plans=len(record.plan_cycle_s),
        sources=dict(sorted(record.sources.items())),
        plan_cycle_ms=[round(1e3 * v, 2) for v in record.plan_cycle_s],
        real_time_factor=flight.time_s / spent_s if spent_s > 0.0 else math.inf,
        track=record.track,
        events=record.events,
        movers=len(movers),
        unseen=referee.unseen_contacts,
        struck=referee.struck,
    )


def _judged(outcome: Outcome, reason: str, error_m: float) -> tuple[Outcome, str]:
    """The robot's own word that it is there, held against the truth."""
    if outcome == "reached" and error_m > REACHED_M:
        return "stopped", f"it believed to be there, but was {error_m:.2f} m off"
    return outcome, reason


def fly_trial(trial: Trial, robot: RobotConfig | None = None) -> TrialResult:
    """Fly one trial; the result but for its wall times follows from the trial alone.

    Args:
        trial: Task and method (`sim.bench.methods`).
        robot: The robot; the default one when left out.
    """
    from sim.bench.methods import find_method, make_planner

    vehicle = robot or RobotConfig()
    method = find_method(trial.method)
    planner = make_planner(trial.method, vehicle, trial.task)
    return fly_with(
        trial.task,
        planner,
        vehicle,
        sees=method.sees,
        true_pose=method.true_pose,
        meets_movers=method.meets_movers,
    )
