// Wheel speeds from encoder ticks over a short window.
#pragma once

#include <stdint.h>

#define LAND_MEASURE_MS 40      // one tick is 6 mm/s over it
#define LAND_MEASURE_SAMPLES 48  // a sample a millisecond and some to spare

typedef struct {
    uint32_t ms;
    int32_t left;
    int32_t right;
} land_sample;

typedef struct {
    land_sample samples[LAND_MEASURE_SAMPLES];  // a ring
    int first;
    int count;
    float left_mps;
    float right_mps;
} land_measure;

// Take the ticks read at `ms`; the same `ms` again replaces them.
void land_measure_add(land_measure *m, uint32_t ms, int32_t left, int32_t right, float ticks_per_m);
