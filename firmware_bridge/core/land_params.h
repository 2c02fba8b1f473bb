// Parameters by name and index. The table, its ranges and defaults come from firmware_bridge/parameters.py.
#pragma once

#include <stdbool.h>
#include <stdint.h>

#include "land_defaults.h"  // generated

#define LAND_PARAM_NAME_BYTES 16

typedef struct {
#define LAND_FIELD(name, low, high, start) float name;
    LAND_PARAMETERS(LAND_FIELD)
#undef LAND_FIELD
} land_params;

typedef enum {
    LAND_PARAM_DONE,
    LAND_PARAM_NO_SUCH,
    LAND_PARAM_OUT_OF_RANGE,
} land_param_result;

enum {
#define LAND_INDEX(name, low, high, start) LAND_PARAM_INDEX_##name,
    LAND_PARAMETERS(LAND_INDEX)
#undef LAND_INDEX
    LAND_PARAM_COUNT
};

// What this robot was flashed with.
land_params land_params_default(void);

// Index of a name, at most LAND_PARAM_NAME_BYTES long and padded with zeros; -1 if there is no such.
int land_params_find(const char *name);

// Name of a valid index.
const char *land_params_name(int index);

// Value of a valid index.
float land_params_get(const land_params *p, int index);

// Change one value if name and value are acceptable; NaN is not.
land_param_result land_params_write(land_params *p, const char *name, float value);

// True if every value lies in its range; a damaged copy does not.
bool land_params_sound(const land_params *p);

// Whether a command [mm/s, mrad/s] is inside the limits.
bool land_params_allow(const land_params *p, int16_t v_mmps, int16_t w_mradps);
