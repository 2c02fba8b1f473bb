#include "land_measure.h"

#include "land_counter.h"

static land_sample *at(land_measure *m, int i) {
    return &m->samples[(m->first + i) % LAND_MEASURE_SAMPLES];
}

static void forget_first(land_measure *m) {
    m->first = (m->first + 1) % LAND_MEASURE_SAMPLES;
    m->count--;
}

void land_measure_add(land_measure *m, uint32_t ms, int32_t left, int32_t right, float ticks_per_m) {
    if (m->count > 0 && at(m, m->count - 1)->ms == ms) {
        m->count--;
    } else if (m->count == LAND_MEASURE_SAMPLES) {
        forget_first(m);
    }
    *at(m, m->count++) = (land_sample){ms, left, right};
    while (m->count > 2 && land_ahead(ms, at(m, 1)->ms) >= LAND_MEASURE_MS) {
        forget_first(m);
    }
    const land_sample *then = at(m, 0);
    const int32_t span_ms = land_ahead(ms, then->ms);
    if (span_ms <= 0) {
        return;
    }
    const float per_tick = 1000.0f / (ticks_per_m * (float)span_ms);
    m->left_mps = (float)land_ahead((uint32_t)left, (uint32_t)then->left) * per_tick;
    m->right_mps = (float)land_ahead((uint32_t)right, (uint32_t)then->right) * per_tick;
}
