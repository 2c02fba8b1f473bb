#include "land_report.h"

#include <math.h>
#include <string.h>

// The next due time after now on the grid of the old one; missed reports are skipped.
static uint32_t next_due(uint32_t due_ms, uint32_t now_ms, uint32_t period_ms) {
    const uint32_t behind_ms = now_ms - due_ms;
    return due_ms + (behind_ms / period_ms + 1) * period_ms;
}

static int16_t int16_of(float value) {
    return (int16_t)lroundf(fmaxf(-32768.0f, fminf(32767.0f, value)));
}

static uint16_t uint16_of(float value) {
    return (uint16_t)lroundf(fmaxf(0.0f, fminf(65535.0f, value)));
}

// 65535 means never.
static uint16_t command_age_ms(const land_controller *c) {
    return c->gate.accepted.set ? (uint16_t)(c->now_ms - c->gate.accepted.ms) : UINT16_MAX;
}

static void send_state(land_controller *c) {
    const land_gate *g = &c->gate;
    const land_inputs *in = &c->inputs;
    const float left = g->measure.left_mps, right = g->measure.right_mps;
    const mavlink_land_state_t m = {
        .time_ms = in->sampled_ms,
        .ticks_left = in->left_ticks,
        .ticks_right = in->right_ticks,
        .v = int16_of(500.0f * (left + right)),
        .w = int16_of(1000.0f * (right - left) / c->params.track),
        .faults = g->faults,
        .battery_mv = uint16_of(1000.0f * in->battery_v),
        .current_ma = uint16_of(1000.0f * in->current_a),
        .current_left = int16_of(1000.0f * in->left_a),
        .current_right = int16_of(1000.0f * in->right_a),
        .duty_left = int16_of(1000.0f * c->left.duty),
        .duty_right = int16_of(1000.0f * c->right.duty),
        .command_age = command_age_ms(c),
        .cmd_seq = g->sequence_seen ? g->sequence : 0,
        .rx_good = (uint16_t)c->link.rx_good,
        .rx_bad = (uint16_t)c->framer.bad_crc,
        .rx_lost = (uint16_t)c->link.rx_lost,
        .mode = land_gate_mode(g),
        .status = land_gate_status(g),
        .last_result = g->last_result,
    };
    land_link_send(&c->link, MAVLINK_MSG_ID_LAND_STATE, &m, MAVLINK_MSG_ID_LAND_STATE_LEN);
}

static void send_heartbeat(land_controller *c) {
    const mavlink_land_heartbeat_t m = {
        .session = c->gate.session,
        .time_ms = c->now_ms,
        .mode = land_gate_mode(&c->gate),
        .engaged = c->gate.engaged,
    };
    land_link_send(&c->link, MAVLINK_MSG_ID_LAND_HEARTBEAT, &m, MAVLINK_MSG_ID_LAND_HEARTBEAT_LEN);
}

void land_report(land_controller *c) {
    if (land_ahead(c->now_ms, c->due_state_ms) >= 0) {
        c->due_state_ms = next_due(c->due_state_ms, c->now_ms, LAND_STATE_PERIOD_MS);
        send_state(c);
        land_checkin_report(&c->checkin, LAND_PART_TELEMETRY);
    }
    if (land_ahead(c->now_ms, c->due_heartbeat_ms) >= 0) {
        c->due_heartbeat_ms = next_due(c->due_heartbeat_ms, c->now_ms, LAND_HEARTBEAT_PERIOD_MS);
        send_heartbeat(c);
    }
}

void land_report_identity(land_controller *c, uint32_t nonce) {
    mavlink_land_identity_t m = {
        .nonce = nonce,
        .session = c->gate.session,
        .dialect_hash = LAND_DIALECT_HASH,
        .firmware = LAND_FIRMWARE,
        .boot_count = c->gate.boot_count,
        .time_ms = c->now_ms,
        .protocol = LAND_PROTOCOL_HERE,
        .reset_cause = c->reset_cause,
    };
    _Static_assert(sizeof m.serial == LAND_SERIAL_BYTES, "the dialect has room for just these digits");
    memcpy(m.serial, c->serial, LAND_SERIAL_BYTES);
    land_link_send(&c->link, MAVLINK_MSG_ID_LAND_IDENTITY, &m, MAVLINK_MSG_ID_LAND_IDENTITY_LEN);
}

void land_report_log(land_controller *c, uint8_t severity, const char *text) {
    mavlink_land_log_t m = {.time_ms = c->now_ms, .severity = severity};
    for (size_t i = 0; i < sizeof m.text && text[i] != 0; i++) {
        m.text[i] = text[i];
    }
    land_link_send(&c->link, MAVLINK_MSG_ID_LAND_LOG, &m, MAVLINK_MSG_ID_LAND_LOG_LEN);
}
