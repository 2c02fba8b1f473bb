#include "land_wheel.h"

#include <math.h>

land_wheel land_wheel_resting(void) {
    return (land_wheel){0.0f, 0.0f, 1.0f};
}

static float ceiling_after(const land_wheel *w, float current_a, const land_params *p, float dt_s) {
    const float excess_a = fabsf(current_a) - p->wheel_current;
    if (excess_a > 0.0f) {
        return fmaxf(0.0f, fminf(w->ceiling, fabsf(w->duty)) - LAND_YIELD_PER_AS * excess_a * dt_s);
    }
    return fminf(1.0f, w->ceiling + LAND_RECOVER_PER_S * dt_s);
}

void land_wheel_step(
    land_wheel *w, float target_mps, float measured_mps, float current_a, const land_params *p, float dt_s) {
    w->ceiling = ceiling_after(w, current_a, p, dt_s);
    if (fabsf(target_mps) < LAND_STANDS_MPS && fabsf(measured_mps) < LAND_STILL_MPS) {
        w->duty = w->integral = 0.0f;
        return;
    }
    const float error = target_mps - measured_mps;
    const float integral = w->integral + p->gain_i * error * dt_s;
    const float wanted = target_mps / p->free_speed + p->gain_p * error + integral;
    if (fabsf(wanted) <= w->ceiling) {
        w->duty = wanted;
        w->integral = integral;
        return;
    }
    if (error * wanted <= 0.0f) {
        w->integral = integral;  // at its limit it may unwind, but not wind up
    }
    w->duty = wanted > 0.0f ? w->ceiling : -w->ceiling;
}
