#include "land_checkin.h"

void land_checkin_report(land_checkin *c, land_part part) {
    c->seen |= (uint32_t)part;
}

bool land_checkin_complete(land_checkin *c) {
    if (c->seen != LAND_PARTS_ALL) {
        return false;
    }
    c->seen = 0;
    return true;
}
