#include "land_faults.h"

#include <math.h>

static bool stalls(float asked, float got) {
    return fabsf(asked) > LAND_STALL_MPS && got * asked < LAND_STALL_SHARE * asked * asked;
}

static bool races(float asked, float got) {
    return fabsf(got) > fmaxf(LAND_RUNAWAY_MPS, LAND_RUNAWAY_RATIO * fabsf(asked));
}

// Whether a condition has held for LAND_LATCH_MS; `since` remembers when it began.
static bool lasts(land_time *since, bool holds, uint32_t now_ms) {
    if (!holds) {
        *since = land_time_none();
        return false;
    }
    if (!since->set) {
        *since = land_time_at(now_ms);
    }
    return land_ahead(now_ms, since->ms) >= LAND_LATCH_MS;
}

uint16_t land_faults_watch(land_gate *g, const land_inputs *in, const land_params *p, uint32_t now_ms) {
    const land_drive *asked = &g->drive;
    const land_measure *got = &g->measure;
    const bool driving = !asked->braked;
    const bool stall =
        driving && (stalls(asked->left_mps, got->left_mps) || stalls(asked->right_mps, got->right_mps));
    const bool race = races(asked->left_mps, got->left_mps) || races(asked->right_mps, got->right_mps);
    const bool hot = driving && in->current_a > p->current_max;
    unsigned faults = in->driver_fault ? LAND_FAULT_DRIVER : 0u;
    faults |= lasts(&g->stalled, stall, now_ms) ? LAND_FAULT_WHEEL_STALL : 0u;
    faults |= lasts(&g->runaway, race, now_ms) ? LAND_FAULT_WHEEL_RUNAWAY : 0u;
    faults |= lasts(&g->overcurrent, hot, now_ms) ? LAND_FAULT_OVERCURRENT : 0u;
    return (uint16_t)faults;
}
