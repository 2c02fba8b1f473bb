#include "land_params.h"

#include <stddef.h>
#include <string.h>

typedef struct {
    const char *name;
    size_t offset;
    float low, high;
} row;

static const row TABLE[LAND_PARAM_COUNT] = {
#define LAND_ROW(name, low, high, start) {#name, offsetof(land_params, name), low, high},
    LAND_PARAMETERS(LAND_ROW)
#undef LAND_ROW
};

static float *value_of(land_params *p, int index) {
    return (float *)(void *)((char *)p + TABLE[index].offset);
}

land_params land_params_default(void) {
    return (land_params){
#define LAND_START(name, low, high, start) .name = (start),
        LAND_PARAMETERS(LAND_START)
#undef LAND_START
    };
}

int land_params_find(const char *name) {
    for (int i = 0; i < LAND_PARAM_COUNT; i++) {
        if (strncmp(name, TABLE[i].name, LAND_PARAM_NAME_BYTES) == 0) {
            return i;
        }
    }
    return -1;
}

const char *land_params_name(int index) {
    return TABLE[index].name;
}

float land_params_get(const land_params *p, int index) {
    float value;
    memcpy(&value, (const char *)p + TABLE[index].offset, sizeof value);
    return value;
}

static bool in_range(int index, float value) {
    return value >= TABLE[index].low && value <= TABLE[index].high;  // false for NaN
}

land_param_result land_params_write(land_params *p, const char *name, float value) {
    const int index = land_params_find(name);
    if (index < 0) {
        return LAND_PARAM_NO_SUCH;
    }
    if (!in_range(index, value)) {
        return LAND_PARAM_OUT_OF_RANGE;
    }
    *value_of(p, index) = value;
    return LAND_PARAM_DONE;
}

bool land_params_sound(const land_params *p) {
    for (int i = 0; i < LAND_PARAM_COUNT; i++) {
        if (!in_range(i, land_params_get(p, i))) {
            return false;
        }
    }
    return true;
}

bool land_params_allow(const land_params *p, int16_t v_mmps, int16_t w_mradps) {
    // The limits are given in single precision: half a unit keeps 1.0 m/s meaning 1000 mm/s.
    const float v = (float)v_mmps, w = (float)w_mradps;
    const float forward = p->speed * 1000.0f + 0.5f, backward = p->reverse * 1000.0f + 0.5f;
    const float turn = p->yaw_rate * 1000.0f + 0.5f;
    return v <= forward && v >= -backward && w <= turn && w >= -turn;
}
