"""When to fly over what is in the way of a goal on land: drive, flight and drive, cheapest together.

The layers of the two-layer search are the driving plan and a slice of the map at the height of flight; going
from one to the other costs a take-off and a landing. It is searched only where the way on land is so long
that a hop could pay at all (`EnergyModel.detour_worth_flying_m`).
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from labr_autonomy.config import RobotConfig
from labr_autonomy.modes.energy import EnergyModel
from labr_autonomy.perception.fields import Bits, Field2
from labr_autonomy.perception.rolling_map import RollingMap
from labr_autonomy.planner import routes
from labr_autonomy.planner.kept_ways import KeptWays
from labr_autonomy.planner.messages import PlanRequest
from labr_autonomy.planner.places import AT_END_M, column_field, flight_layer
from labr_autonomy.planner.refusals import Refusals
from labr_autonomy.planner.take_off import offers_by_air
from labr_autonomy.refine.search import CostToGo
from labr_autonomy.types import Array, Mode

REFUSED_M = 0.8  # a place where it could not land after all, and so much around it
ROUND = 3.0  # times the straight way, in weighted metres (3 where nothing was seen), is a long way round ...
MORE_M, MORE_MPS = 2.0, 0.25  # ... beyond so much, which rises with each second of flight
ALOFT_MAX_S = 15.0  # after so long it comes down wherever there is room: hovering costs more than a detour
SAME_M = 0.3  # ends nearer to each other than this are one
SETTLE_M = 0.3  # flying on must save more than so many metres of flight
UNKNOWN_COST = 4.0  # of a hop's metres where nothing was seen: it is not flown on a guess

Again = Callable[[Array], CostToGo]


def dearness(land: CostToGo, here_m: Array) -> float:
    """Cost of the way on land over its length: what is narrow or unknown counts more than its metres.

    A flight's metres are made as much dearer, so that it is joules that decide and not what was not seen.
    """
    way = land.path(here_m[:2])
    length_m = 0.0 if way is None else routes.length_m(way)
    return max(1.0, land.cost_m(here_m[:2]) / length_m) if length_m > 0.0 else 1.0


class Hops:
    """The search, and what it remembers between cycles.

    Args:
        config: Outline and clearances.
        seen: The rolling map.
        air_hard_m: Least distance of a flight to obstacles.
        no_take_off: Where it could not take off.
    """

    def __init__(
        self, config: RobotConfig, seen: RollingMap, air_hard_m: float, no_take_off: Refusals
    ) -> None:
        self._map, self._air_hard_m = seen, air_hard_m
        self._config, self._energy = config, EnergyModel.of(config)
        self._end: Array | None = None  # where a drive without a hop would end, if hops are looked for
        self._no_take_off, self._refused = no_take_off, Refusals(REFUSED_M)
        self._landings = KeptWays()
        self._aloft_s: float | None = None  # since when it flies

    def reset(self) -> None:
        """Another goal: forget what was planned and where it could not land."""
        self._end, self._aloft_s = None, None
        self._refused.reset()

    def anywhere(self) -> None:
        """Let the present flight come down wherever there is room."""
        self._aloft_s = -math.inf

    def planned(self, ways: CostToGo, here_m: Array) -> bool:
        """Whether the way from here takes off at its end."""
        if self._end is None:
            return False
        end = ways.end(here_m[:2])
        return end is not None and float(np.hypot(*(end - self._end))) > SAME_M

    def on_land(self, request: PlanRequest, plan: Field2, land: CostToGo, again: Again) -> CostToGo:
        """Ways to a goal on land that may end where a hop begins.

        Args:
            request: Of the cycle.
            plan: The driving plan.
            land: Ways that only drive.
            again: Makes ways that end wherever driving and an offer [m of driving] are cheapest together.
        """
        here, self._end = request.body_pose.position_m, None
        hop_m = self._energy.detour_worth_flying_m(0.0, 0.0)
        least_m = float(np.hypot(*(request.goal_m[:2] - here[:2]))) + hop_m
        if not request.may_hop or land.cost_m(here[:2]) <= least_m:  # a way is no longer than it costs
            return land
        way, end = land.path(here[:2]), land.end(here[:2])
        if way is None or end is None or routes.length_m(way) <= least_m:
            return land  # no hop is so cheap
        dear = dearness(land, here)
        air = self._to_landings(request, land, request.lift_to_m, dear)
        column, radius_m = column_field(self._map, self._config, request, request.lift_to_m)
        offers = offers_by_air(plan, air, column, radius_m, here, self._energy, self._no_take_off)
        offers = dear * (offers + hop_m)
        cell = np.floor((end - plan.origin_m) / plan.cell_m).astype(int)
        offers[cell[0], cell[1]] = 0.0
        self._end = end
        return again(offers)

    def in_air(self, request: PlanRequest, land: CostToGo) -> CostToGo:
        """Ways at the present height to where landing and driving on are cheapest, kept for a while."""
        here, goal = request.body_pose.position_m, request.goal_m
        level = round(float(here[2]) / self._map.cell_m)
        asked = (float(goal[0]), float(goal[1]), float(level), float(len(self._refused)), self._late(request))
        return self._landings.of(
            asked,
            request.start_s,
            lambda: self._to_landings(request, land, float(here[2]), dearness(land, here), crossed=True),
        )

    def may_land(self, request: PlanRequest, land: CostToGo, room: bool) -> bool:
        """Whether to come down here: there is room, and driving from here is no dearer than flying on.

        A place above which it stays without may is refused: the next best is flown to.
        """
        here = request.body_pose.position_m[:2]
        air = self.in_air(request, land)
        worth = dearness(land, here) * self._energy.metre_in_air()
        drive_m, on_m = land.cost_m(here), air.cost_m(here)
        crossed = bool(self._crossed(request, land, here[None])[0])
        may = room and crossed and math.isfinite(drive_m) and not drive_m > worth * (on_m + SETTLE_M)
        may |= room and self._late(request)
        end = air.end(here)
        above = end is not None and float(np.hypot(*(end - here))) <= AT_END_M
        self._refused.step(above and not may, end, request.start_s)
        return may

    def _crossed(self, request: PlanRequest, land: CostToGo, places_m: Array) -> Bits:
        """Places (n, 2) from which the goal is no long way round any more.

        What a map shows as a gap from above must not bring it down on the side that it came from; the longer
        it flies, the less it insists.
        """
        if request.mode is Mode.AIR and self._aloft_s is None:
            self._aloft_s = request.start_s
        more_m = MORE_M
        if self._aloft_s is not None:
            more_m += MORE_MPS * (request.start_s - self._aloft_s)
        straight_m = np.hypot(*(places_m - request.goal_m[:2]).T)
        out: Bits = land.costs_at(places_m) <= ROUND * straight_m + more_m
        return out

    def _late(self, request: PlanRequest) -> bool:
        """Whether it has flown for so long that it comes down wherever there is room."""
        return self._aloft_s is not None and request.start_s - self._aloft_s > ALOFT_MAX_S

    def _to_landings(
        self, request: PlanRequest, land: CostToGo, height_m: float, dear: float, *, crossed: bool = False
    ) -> CostToGo:
        """Ways at a height to where it may land, by `landing_offers`; `crossed`: only beyond what it hops."""
        layer = flight_layer(self._map, self._config, request.body_pose, height_m)
        column, radius_m = column_field(self._map, self._config, request, height_m)
        offers = landing_offers(layer, land, column, radius_m, dear, self._energy, self._refused)
        if self._late(request):
            offers = np.where(column.lookup(centres(layer)) > radius_m, 0.0, np.inf).reshape(offers.shape)
        elif crossed:
            offers[~self._crossed(request, land, centres(layer)).reshape(offers.shape)] = np.inf
        return CostToGo(layer, request.goal_m[:2], self._air_hard_m, UNKNOWN_COST, offers=offers)


def landing_offers(
    layer: Field2,
    land: CostToGo,
    column: Field2,
    radius_m: float,
    dear: float,
    energy: EnergyModel,
    refused: Refusals,
) -> Array:
    """What it costs to drive on from each cell of a layer of flight, (nx, ny) [m of flying].

    Args:
        layer: The slice at the height of flight.
        land: Ways on land to the goal.
        column: Distance to what stands between the floor and the height of flight.
        radius_m: Free radius that a landing needs.
        dear: By so much a flight's metres are dearer; `dearness`.
        energy: What a metre costs in each mode.
        refused: Where it could not land.

    Returns:
        inf where it could not land or not drive on.
    """
    middles = centres(layer)
    fits = (column.lookup(middles) > radius_m) & ~refused.among(middles)
    worth = dear * energy.metre_in_air()
    out: Array = np.where(fits, land.costs_at(middles) / worth, np.inf).reshape(layer.distance_m.shape)
    return out


def centres(field: Field2) -> Array:
    """Middles (nx * ny, 2) of a plan's cells, odom."""
    i, j = np.indices(field.distance_m.shape)
    out: Array = field.origin_m + (np.stack([i.ravel(), j.ravel()], axis=1) + 0.5) * field.cell_m
    return out
