"""One trial in a few lines for a person."""

from __future__ import annotations

from sim.lockstep.trial import REACHED_M, Task, TrialResult


def describe(task: Task, result: TrialResult, *, events: int) -> list[str]:
    """The task, how it ended, its figures and what happened on the way.

    Args:
        task: What was asked.
        result: How it went.
        events: At most so many; the middle is left out.
    """
    x, y, yaw, floor = task.start
    gx, gy, gz = task.goal_m
    where = "in the air" if task.in_air else "on the floor"
    sight = "in sight" if task.in_sight else "out of sight"
    cycles = sorted(result.plan_cycle_ms)
    middle = f", half within {cycles[len(cycles) // 2]:.0f} ms" if cycles else ""
    lines = [
        f"task     from ({x:.2f}, {y:.2f}) m, floor at {floor:.2f} m, heading {yaw:.2f} rad",
        f"         to ({gx:.2f}, {gy:.2f}, {gz:.2f}) m {where}, {sight}, {task.distance_m:.1f} m away",
        f"at best  {task.shortest_m:.1f} m, {task.bound_j / 1e3:.2f} kJ, {task.bound_s:.0f} s; "
        f"timeout after {task.limit_s:.0f} s",
        f"outcome  {result.outcome}: {result.reason or 'no reason given'}",
        f"         {result.goal_error_m:.2f} m from the goal (reached within {REACHED_M} m), "
        f"{result.time_s:.1f} s",
        f"way      {result.land_m:.1f} m driven, {result.air_m:.1f} m flown, "
        f"smallest clearance {result.min_clearance_m:.2f} m",
        f"energy   {result.energy_j / 1e3:.2f} kJ: {result.energy_land_j / 1e3:.2f} on land, "
        f"{result.energy_air_j / 1e3:.2f} in the air, {result.energy_transition_j / 1e3:.2f} between",
        f"plans    {result.plans}{middle}"
        + "".join(f", {count} {source}" for source, count in sorted(result.sources.items())),
    ]
    if task.movers:
        people = sum(m["shape"]["kind"] == "person" for m in task.movers)
        struck = f"; the robot was struck {result.struck} times while it stood" if result.struck else ""
        lines.append(f"movers   {people} people, {len(task.movers) - people} boxes{struck}")
    return lines + _events(result, events)


def _events(result: TrialResult, most: int) -> list[str]:
    shown = [f"{t_s:7.1f} s  {sentence}" for t_s, sentence in result.events]
    if len(shown) <= most:
        return shown
    first = most // 2
    hidden = len(shown) - most
    return [*shown[:first], f"           ... {hidden} more ...", *shown[len(shown) - (most - first) :]]
