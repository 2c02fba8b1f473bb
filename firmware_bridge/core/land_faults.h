// Conditions of wheels and drivers that latch when they last.
#pragma once

#include "land_gate.h"

#define LAND_LATCH_MS 600  // a wheel or the current must misbehave this long
#define LAND_STALL_MPS 0.10f
#define LAND_STALL_SHARE 0.2f
#define LAND_RUNAWAY_MPS 0.30f
#define LAND_RUNAWAY_RATIO 2.0f

#define LAND_FAULTS_LATCHED                                                                           \
    ((unsigned)(LAND_FAULT_WHEEL_STALL | LAND_FAULT_WHEEL_RUNAWAY | LAND_FAULT_OVERCURRENT | LAND_FAULT_DRIVER))

// Faults that have to be latched now; a wheel that stands, one that races (it slips, or its encoder lies),
// too high a current, a driver's own word.
uint16_t land_faults_watch(land_gate *g, const land_inputs *in, const land_params *p, uint32_t now_ms);
