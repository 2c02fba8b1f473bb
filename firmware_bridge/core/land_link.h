// The controller's end of the wire: frames of the dialect out through a ring, and who is listened to.
#pragma once

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "land_frame.h"
#include "land_mavlink.h"

#define LAND_SYSTEM 1
#define LAND_COMPUTER 191   // MAV_COMP_ID_ONBOARD_COMPUTER
#define LAND_CONTROLLER 68  // MAV_COMP_ID_USER44
#define LAND_TX_BYTES 1024

typedef struct {
    uint8_t tx[LAND_TX_BYTES];  // a ring of whole frames
    size_t tx_first;
    size_t tx_used;
    uint32_t tx_dropped;  // frames that found no room
    uint8_t tx_sequence;
    uint32_t rx_good;
    uint32_t rx_lost;  // missing by sequence number
    bool rx_known;
    uint8_t rx_next;
} land_link;  // all zero is one over which nothing went

// Give a message number, payload and sequence to the ring, trailing zeros cut as MAVLink 2 wants it.
void land_link_send(land_link *l, uint32_t message, const void *payload, uint8_t length);

// Take up to `room` bytes that are to go out.
size_t land_link_take(land_link *l, uint8_t *out, size_t room);

// Count a good frame; false if it is not the computer's.
bool land_link_accept(land_link *l, const uint8_t *frame);
