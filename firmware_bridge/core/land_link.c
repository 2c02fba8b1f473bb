#include "land_link.h"

static void push(land_link *l, const uint8_t *bytes, size_t length) {
    for (size_t i = 0; i < length; i++) {
        l->tx[(l->tx_first + l->tx_used++) % LAND_TX_BYTES] = bytes[i];
    }
}

void land_link_send(land_link *l, uint32_t message, const void *payload, uint8_t length) {
    const uint8_t *bytes = payload;
    while (length > 1 && bytes[length - 1] == 0) {
        length--;
    }
    const uint8_t header[LAND_FRAME_HEADER] = {
        LAND_FRAME_START, length, 0, 0, l->tx_sequence++, LAND_SYSTEM, LAND_CONTROLLER,
        (uint8_t)message, (uint8_t)(message >> 8), (uint8_t)(message >> 16),
    };
    if (l->tx_used + LAND_FRAME_HEADER + length + LAND_FRAME_CRC > LAND_TX_BYTES) {
        l->tx_dropped++;  // the other side sees it by the sequence
        return;
    }
    uint16_t crc = crc_calculate(header + 1, LAND_FRAME_HEADER - 1);
    crc_accumulate_buffer(&crc, payload, length);
    crc_accumulate(mavlink_get_msg_entry(message)->crc_extra, &crc);
    push(l, header, LAND_FRAME_HEADER);
    push(l, bytes, length);
    push(l, (const uint8_t[]){(uint8_t)crc, (uint8_t)(crc >> 8)}, LAND_FRAME_CRC);
}

size_t land_link_take(land_link *l, uint8_t *out, size_t room) {
    size_t taken = 0;
    while (taken < room && l->tx_used > 0) {
        out[taken++] = l->tx[l->tx_first];
        l->tx_first = (l->tx_first + 1) % LAND_TX_BYTES;
        l->tx_used--;
    }
    return taken;
}

bool land_link_accept(land_link *l, const uint8_t *frame) {
    if (frame[5] != LAND_SYSTEM || frame[6] != LAND_COMPUTER) {
        return false;
    }
    if (l->rx_known) {
        l->rx_lost += (uint8_t)(frame[4] - l->rx_next);
    }
    l->rx_known = true;
    l->rx_next = (uint8_t)(frame[4] + 1);
    l->rx_good++;
    return true;
}
