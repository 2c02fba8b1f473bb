"""The oracle: the best that this robot's second stage and pilot can do when the whole world is known.

It follows the route of least energy with the flight's own refiner on true distance fields, and tells the
pilot's mode decision where the route leaves the floor and comes down. It is the upper bound in the bench:
whatever a method loses against it is lost in seeing and deciding, not in following.
"""

from __future__ import annotations

import math

import numpy as np

from labr_autonomy.clock import SystemClock
from labr_autonomy.config import RobotConfig
from labr_autonomy.perception.fields import Field2, Field3
from labr_autonomy.planner.messages import PlanRequest, PlanResult, Timings
from labr_autonomy.refine.planner import Refiner
from labr_autonomy.refine.reference import along, to_key_points
from labr_autonomy.refine.values import AirState, LandState, RefineResult
from labr_autonomy.types import Array, DepthFrame, KeyPoints, Mode, Source, Trajectory
from sim.bench.known import Known, know
from sim.bench.route import Route
from sim.lockstep.trial import Task
from sim.worlds.free_layers import HEAD_FROM_M

OFF_ROUTE_M = 0.7  # farther from its leg than this, the route is searched anew
AGAIN_S = 1.0  # but not more often than this
LIFT_OFF_M = 0.4  # this near to the leg's end the decision may switch
AT_END_M = 0.15
SPACING_M = 0.4  # of the points that the refiner is given
POINTS = 9
FIELD_HALF_M = (3.5, 3.5)
KEEP_M = 0.5  # a true field around a place serves this far away from it


class OraclePlanner:
    """Plans along the route of least energy through the whole world.

    Args:
        config: The robot.
        task: The trial's task; its world is built here, with all that is free in it.
    """

    def __init__(self, config: RobotConfig, task: Task) -> None:
        self._config = config
        self._clock = SystemClock()
        self._known: Known = know(task.world, config)
        self._refiner = Refiner(config)
        self._previous: Trajectory | None = None
        self._route: Route | None = None
        self._leg = 0
        self._asked: tuple[bytes, bool] | None = None
        self._routed_s = -math.inf
        self._ground: tuple[Array, Field2] | None = None  # where it was taken, and the map
        self._space: tuple[Array, Field3] | None = None

    def cycle(self, request: PlanRequest, frame: DepthFrame | None) -> PlanResult:
        """Plan once. The frame is not looked at."""
        began_s = self._clock.now_s()
        if request.fresh or (self._previous is not None and self._previous.mode is not request.mode):
            self._previous = None
        self._follow(request)
        routed_s = self._clock.now_s()
        ahead = self._ahead(request)
        if ahead is None:
            refined, points = self._stay(request), np.array(request.motion.position_m)[None]
        else:
            points = to_key_points(ahead, POINTS, SPACING_M)
            refined = (
                self._drive(request, points) if request.mode is Mode.LAND else self._fly(request, points)
            )
        done_s = self._clock.now_s()
        self._previous = refined.trajectory
        followed = KeyPoints(points, np.full(len(points), request.mode is Mode.AIR), 0.0, Source.SEARCH)
        lift_off_m, ends, take_off, landing = self._switches(request, ahead)
        return PlanResult(
            sequence=request.sequence,
            frame_stamp_s=frame.stamp_s if frame is not None else math.nan,
            trajectory=refined.trajectory,
            network=followed,
            followed=followed,
            source=refined.source,
            clearance_m=refined.clearance_m,
            reason=refined.reason if ahead is not None else "there is no way to the goal",
            lift_off_m=lift_off_m,
            land_path_ends=ends,
            take_off_clear=take_off,
            landing_clear=landing,
            timings=Timings(route_s=routed_s - began_s, refine_s=done_s - routed_s, total_s=done_s - began_s),
            hop=self._route is not None and self._leg < len(self._route.legs) - 1,
        )

    # ------------------------------------------------------------------ where on the route
    def _follow(self, request: PlanRequest) -> None:
        """Find the leg that is being travelled; search a route where there is none that fits."""
        asked = (np.asarray(request.goal_m, dtype=float).tobytes(), request.goal_in_air)
        if asked != self._asked:
            self._route, self._asked, self._routed_s = None, asked, -math.inf
        flying = request.mode is Mode.AIR
        if self._route is not None and not flying:
            legs = self._route.legs
            if self._leg < len(legs) and legs[self._leg].mode is Mode.LAND:
                gap = _gap_m(legs[self._leg].points_m[:, :2], request.motion.position_m[:2])
                if gap < OFF_ROUTE_M:
                    return
        elif self._route is not None and self._route.legs[self._leg].mode is Mode.AIR:
            gap = _gap_m(self._route.legs[self._leg].points_m, request.motion.position_m)
            if gap < OFF_ROUTE_M:
                return
        changed = self._route is None or self._route.legs[self._leg].mode is not request.mode
        if not changed and request.start_s - self._routed_s < AGAIN_S:
            return
        self._routed_s, self._leg = request.start_s, 0
        self._route = self._search(request, flying)

    def _search(self, request: PlanRequest, flying: bool) -> Route | None:
        """A route from here; take-offs have the room that the pilot will ask for, if there is one such."""
        here = np.array(request.motion.position_m, dtype=float)
        goal = np.array(request.goal_m, dtype=float)
        if not flying:
            here[2] = request.floor_z_m + self._config.body.below_m
        router = self._known.router
        for lift_to_m in (request.lift_to_m, -math.inf):
            found = router.route(
                here, goal, start_in_air=flying, goal_in_air=request.goal_in_air, lift_to_m=lift_to_m
            )
            if found is not None:
                return found
        return None

    def _ahead(self, request: PlanRequest) -> Array | None:
        """What is left of the present leg from the place nearest to the robot on, (k, 3)."""
        if self._route is None or self._route.legs[self._leg].mode is not request.mode:
            return None
        points = self._route.legs[self._leg].points_m
        axes = 2 if request.mode is Mode.LAND else 3
        reached = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
        arc = _nearest_arc_m(points[:, :axes], np.asarray(request.motion.position_m)[:axes], reached)
        rest: Array = np.vstack([along(points, np.array([arc])), points[reached > arc + 1e-6]])
        return rest if len(rest) > 1 else np.vstack([rest, rest])

    # ------------------------------------------------------------------ second stage
    def _drive(self, request: PlanRequest, points: Array) -> RefineResult:
        motion = request.motion
        here = np.array(motion.position_m, dtype=float)
        state = LandState(here[:2], motion.yaw_rad, motion.speed_mps, motion.yaw_rate_rps, float(here[2]))
        stand = np.array([*here[:2], request.floor_z_m + self._config.body.below_m])
        if self._ground is None or math.dist(stand, self._ground[0]) > KEEP_M:
            self._ground = stand, self._known.free.land_field(stand, FIELD_HALF_M)
        field = self._ground[1]
        return self._refiner.land(state, points, field, request.start_s, self._previous, source=Source.SEARCH)

    def _fly(self, request: PlanRequest, points: Array) -> RefineResult:
        motion = request.motion
        here = motion.position_m
        state = AirState(here, motion.velocity_mps, motion.acceleration_mps2, motion.yaw_rad)
        if self._space is None or math.dist(here, self._space[0]) > KEEP_M:
            self._space = here, self._known.free.air_field(here, FIELD_HALF_M)
        field = self._space[1]
        return self._refiner.air(
            state,
            points,
            field,
            request.start_s,
            self._previous,
            source=Source.SEARCH,
            floor_m=request.floor_z_m,
        )

    def _stay(self, request: PlanRequest) -> RefineResult:
        """Come to rest: there is nothing to follow."""
        motion = request.motion
        here = motion.position_m
        if request.mode is Mode.LAND:
            state = LandState(here[:2], motion.yaw_rad, motion.speed_mps, motion.yaw_rate_rps, float(here[2]))
            trajectory = self._refiner.brake_land(state, request.start_s)
        else:
            flight = AirState(here, motion.velocity_mps, motion.acceleration_mps2, motion.yaw_rad)
            trajectory = self._refiner.brake_air(flight, request.start_s)
        return RefineResult(trajectory, Source.BRAKE, math.nan, True, "", 0.0)

    # ------------------------------------------------------------------ what the mode decision is told
    def _switches(self, request: PlanRequest, ahead: Array | None) -> tuple[float, bool, bool, bool]:
        """Metres to the take-off, whether the drive ends here, room to take off, room to land.

        Room is granted only where the route itself switches, so that the pilot does it there.
        """
        if ahead is None or self._route is None:
            return math.inf, False, False, False
        left = float(np.hypot(*np.diff(ahead[:, :2], axis=0).T).sum())
        last = self._leg == len(self._route.legs) - 1
        here = np.asarray(request.body_pose.position_m, dtype=float)
        if request.mode is Mode.LAND:
            if last:  # the route stays on the floor
                return math.inf, False, False, False
            off = max(left, float(math.dist(here[:2], ahead[-1, :2])))
            near = off <= LIFT_OFF_M
            return off, off <= AT_END_M, near and self._column_clear(request, request.lift_to_m), False
        if last:
            return math.inf, False, False, False
        over = math.dist(here[:2], ahead[-1, :2]) <= AT_END_M and left <= AT_END_M
        return math.inf, False, False, over and self._column_clear(request, float(here[2]))

    def _column_clear(self, request: PlanRequest, up_to_m: float) -> bool:
        """Whether the outline and its landing ring are free from the floor here up to a body height."""
        body, ring_m = self._config.body, self._config.clearance.landing_m
        x, y, z = (float(v) for v in request.body_pose.position_m)
        floor = self._known.surface.floor_below(x, y, z)
        if not math.isfinite(floor):
            return False
        foot = np.array([[x, y, floor + HEAD_FROM_M]])
        head = float(self._known.surface.headrooms(foot, body.radius_m + ring_m)[0])
        return head >= up_to_m + body.above_m + ring_m


def _nearest_arc_m(points: Array, place: Array, reached_m: Array) -> float:
    """Arc length of the point of a line (k, d) that is nearest to a place (d,)."""
    leg, base = np.diff(points, axis=0), points[:-1]
    part = np.einsum("ij,ij->i", place - base, leg) / np.maximum(np.einsum("ij,ij->i", leg, leg), 1e-12)
    part = np.clip(part, 0.0, 1.0)
    gap = np.linalg.norm(base + part[:, None] * leg - place, axis=1)
    i = int(gap.argmin())
    return float(reached_m[i] + part[i] * (reached_m[i + 1] - reached_m[i]))


def _gap_m(points: Array, place: Array) -> float:
    """Distance of a place (d,) from a line (k, d)."""
    leg, base = np.diff(points, axis=0), points[:-1]
    part = np.einsum("ij,ij->i", place - base, leg) / np.maximum(np.einsum("ij,ij->i", leg, leg), 1e-12)
    foot = base + np.clip(part, 0.0, 1.0)[:, None] * leg
    return float(np.linalg.norm(foot - place, axis=1).min())
