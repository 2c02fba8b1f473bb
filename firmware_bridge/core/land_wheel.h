// One wheel's speed controller: feed-forward and PI on the encoder's speed, with the motor's current limited.
#pragma once

#include "land_params.h"

#define LAND_STANDS_MPS 5e-4f       // a slower target is none
#define LAND_STILL_MPS 0.02f       // slower than this a wheel that is to stand gets no duty
#define LAND_YIELD_PER_AS 4.0f     // share of the duty given up for an ampere too much during a second
#define LAND_RECOVER_PER_S 2.0f    // share of the duty won back in a second

typedef struct {
    float duty;      // [-1, 1], positive is forward
    float integral;  // its part of the duty
    float ceiling;   // of the duty's magnitude, lowered by too much current
} land_wheel;

// At rest, with no current seen.
land_wheel land_wheel_resting(void);

// Advance by `dt_s` towards `target_mps`; `w->duty` is the result.
void land_wheel_step(
    land_wheel *w, float target_mps, float measured_mps, float current_a, const land_params *p, float dt_s);
