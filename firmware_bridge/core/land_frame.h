// Cut a byte stream into MAVLink 2 frames and lose as little as possible when it is damaged.
// The rules, and what each guard is for, are those of firmware_bridge/framing.py.
#pragma once

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define LAND_FRAME_START 0xFDu
#define LAND_FRAME_HEADER 10u
#define LAND_FRAME_CRC 2u
#define LAND_FRAME_PAYLOAD_MAX 64u  // no message of the dialect is longer
#define LAND_FRAME_MAX (LAND_FRAME_HEADER + LAND_FRAME_PAYLOAD_MAX + LAND_FRAME_CRC)
#define LAND_FRAME_IDLE_MS 20u

// Where good frames go; the frame is valid during the call only.
typedef void (*land_frame_taker)(void *context, const uint8_t *frame);

typedef struct {
    uint8_t buffer[LAND_FRAME_MAX];
    size_t used;
    uint32_t last_ms;
    bool ever;  // bytes came before
    uint32_t bad_crc;
} land_framer;  // all zero is one that has seen nothing

// Take `length` bytes that came at `now_ms`.
void land_framer_feed(
    land_framer *f, const uint8_t *bytes, size_t length, uint32_t now_ms, land_frame_taker take, void *context);

// Message number of a frame.
uint32_t land_frame_message(const uint8_t *frame);
