#include "land_frame.h"

#include <string.h>

#include "land_mavlink.h"

uint32_t land_frame_message(const uint8_t *frame) {
    return (uint32_t)frame[7] | (uint32_t)frame[8] << 8 | (uint32_t)frame[9] << 16;
}

static void drop(land_framer *f, size_t count) {
    f->used -= count;
    memmove(f->buffer, f->buffer + count, f->used);
}

// Drop bytes up to a start byte; false if there is none.
static bool seek_start(land_framer *f) {
    size_t i = 0;
    while (i < f->used && f->buffer[i] != LAND_FRAME_START) {
        i++;
    }
    drop(f, i);
    return f->used > 0;
}

// Whether the bytes so far may begin a frame; `*length` is its length once the header is complete, else 0.
static bool plausible(const land_framer *f, size_t *length) {
    *length = 0;
    if (f->used > 2 && f->buffer[2] != 0) {  // no incompatibility flag is part of this link, signing neither
        return false;
    }
    if (f->used < LAND_FRAME_HEADER) {
        return true;
    }
    const mavlink_msg_entry_t *entry = mavlink_get_msg_entry(land_frame_message(f->buffer));
    if (entry == NULL || f->buffer[1] < 1 || f->buffer[1] > entry->max_msg_len) {
        return false;
    }
    *length = LAND_FRAME_HEADER + f->buffer[1] + LAND_FRAME_CRC;
    return true;
}

static bool crc_good(const uint8_t *frame, size_t length) {
    const mavlink_msg_entry_t *entry = mavlink_get_msg_entry(land_frame_message(frame));
    uint16_t crc = crc_calculate(frame + 1, (uint16_t)(length - 1 - LAND_FRAME_CRC));
    crc_accumulate(entry->crc_extra, &crc);
    return frame[length - 2] == (crc & 0xFF) && frame[length - 1] == crc >> 8;
}

// Take frames off the buffer until it needs more bytes.
static void cut(land_framer *f, land_frame_taker take, void *context) {
    while (seek_start(f)) {
        size_t length;
        if (!plausible(f, &length)) {
            drop(f, 1);
            continue;
        }
        if (length == 0 || f->used < length) {
            return;
        }
        if (crc_good(f->buffer, length)) {
            take(context, f->buffer);
            drop(f, length);
        } else {
            f->bad_crc++;
            drop(f, 1);
        }
    }
}

void land_framer_feed(
    land_framer *f, const uint8_t *bytes, size_t length, uint32_t now_ms, land_frame_taker take, void *context) {
    if (f->ever && now_ms - f->last_ms >= LAND_FRAME_IDLE_MS) {
        while (f->used > 0) {  // the rest of what waits will not come; frames behind a false start still count
            drop(f, 1);
            cut(f, take, context);
        }
    }
    f->last_ms = now_ms;
    f->ever = true;
    for (size_t i = 0; i < length; i++) {
        f->buffer[f->used++] = bytes[i];  // never full: a frame that is complete leaves in `cut`
        cut(f, take, context);
    }
}
