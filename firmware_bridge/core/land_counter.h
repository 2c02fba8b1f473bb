// Counters that wrap: times in milliseconds, sequence numbers, encoder ticks.
#pragma once

#include <stdbool.h>
#include <stdint.h>

// Signed distance of two 32-bit counters, right as long as they are less than half a turn apart.
static inline int32_t land_ahead(uint32_t later, uint32_t earlier) {
    return (int32_t)(later - earlier);
}

#define LAND_EARLY_MS 10  // a stamp may be this far in the future, no more

// Whether a stamp is at most `limit_ms` old. After half a turn of the counter, 24.9 days, a stamp that nobody has
// touched seems to lie in the future: that is not young either.
static inline bool land_young(uint32_t now_ms, uint32_t stamp_ms, int32_t limit_ms) {
    const int32_t age_ms = land_ahead(now_ms, stamp_ms);
    return age_ms >= -LAND_EARLY_MS && age_ms <= limit_ms;
}

// `land_ahead` for 16 bits.
static inline int16_t land_ahead16(uint16_t later, uint16_t earlier) {
    return (int16_t)(uint16_t)(later - earlier);
}

// A time that may not have come yet.
typedef struct {
    uint32_t ms;
    bool set;
} land_time;

static inline land_time land_time_at(uint32_t ms) {
    return (land_time){ms, true};
}

static inline land_time land_time_none(void) {
    return (land_time){0, false};
}
