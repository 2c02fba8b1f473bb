#include "land_controller.h"

#include <string.h>

#include "land_report.h"

static void answer(land_controller *c, uint16_t of, uint16_t sequence, uint8_t result, uint32_t token) {
    const mavlink_land_ack_t m = {.token = token, .of = of, .cmd_seq = sequence, .result = result};
    land_link_send(&c->link, MAVLINK_MSG_ID_LAND_ACK, &m, MAVLINK_MSG_ID_LAND_ACK_LEN);
}

static void answer_param(land_controller *c, uint16_t of, uint16_t sequence, int index) {
    answer(c, of, sequence, LAND_RESULT_OK, 0);
    mavlink_land_param_t m = {
        .value = land_params_get(&c->params, index),
        .index = (uint16_t)index,
        .count = LAND_PARAM_COUNT,
    };
    const char *name = land_params_name(index);
    memcpy(m.name, name, strlen(name));  // none is longer than the field, a test of the table holds it so
    land_link_send(&c->link, MAVLINK_MSG_ID_LAND_PARAM, &m, MAVLINK_MSG_ID_LAND_PARAM_LEN);
}

static void on_hello(land_controller *c, const mavlink_message_t *message) {
    mavlink_land_hello_t m;
    mavlink_msg_land_hello_decode(message, &m);
    land_gate_hello(&c->gate, m.nonce, m.protocol, m.dialect_hash, c->now_ms);
    land_report_identity(c, m.nonce);
}

static void on_heartbeat(land_controller *c, const mavlink_message_t *message) {
    mavlink_land_heartbeat_t m;
    mavlink_msg_land_heartbeat_decode(message, &m);
    land_gate_heartbeat(&c->gate, m.session, m.engaged == 1, c->now_ms);
}

static void on_velocity(land_controller *c, const mavlink_message_t *message) {
    mavlink_land_velocity_t m;
    mavlink_msg_land_velocity_decode(message, &m);
    const land_command command = {
        .session = m.session,
        .deadline_ms = m.deadline_ms,
        .v_mmps = m.v,
        .w_mradps = m.w,
        .sequence = m.cmd_seq,
        .engaged = (m.flags & LAND_FLAG_ENGAGED) != 0,
        .air_lock = (m.flags & LAND_FLAG_AIR_LOCK) != 0,
    };
    const uint8_t result = land_gate_velocity(&c->gate, &command, &c->params, c->now_ms);
    if (result != LAND_RESULT_OK) {
        answer(c, MAVLINK_MSG_ID_LAND_VELOCITY, m.cmd_seq, result, 0);
    }
}

static void on_param_read(land_controller *c, const mavlink_message_t *message) {
    mavlink_land_param_read_t m;
    mavlink_msg_land_param_read_decode(message, &m);
    int index = land_params_find(m.name);
    if (m.name[0] == 0 && m.index < LAND_PARAM_COUNT) {
        index = m.index;
    }
    if (index < 0) {
        answer(c, MAVLINK_MSG_ID_LAND_PARAM_READ, m.cmd_seq, LAND_RESULT_UNKNOWN, 0);
        return;
    }
    answer_param(c, MAVLINK_MSG_ID_LAND_PARAM_READ, m.cmd_seq, index);
}

static uint8_t write_param(land_controller *c, const mavlink_land_param_write_t *m) {
    if (!land_gate_session_is(&c->gate, m->session)) {
        return LAND_RESULT_SESSION;
    }
    if (c->gate.engaged) {
        return LAND_RESULT_BUSY;
    }
    const land_param_result written = land_params_write(&c->params, m->name, m->value);
    if (written == LAND_PARAM_NO_SUCH) {
        return LAND_RESULT_UNKNOWN;
    }
    return written == LAND_PARAM_OUT_OF_RANGE ? LAND_RESULT_RANGE : LAND_RESULT_OK;
}

static void on_param_write(land_controller *c, const mavlink_message_t *message) {
    mavlink_land_param_write_t m;
    mavlink_msg_land_param_write_decode(message, &m);
    const uint8_t result = write_param(c, &m);
    if (result != LAND_RESULT_OK) {
        answer(c, MAVLINK_MSG_ID_LAND_PARAM_WRITE, m.cmd_seq, result, 0);
        return;
    }
    answer_param(c, MAVLINK_MSG_ID_LAND_PARAM_WRITE, m.cmd_seq, land_params_find(m.name));
}

static void on_estop(land_controller *c, const mavlink_message_t *message) {
    mavlink_land_estop_t m;
    mavlink_msg_land_estop_decode(message, &m);
    const bool was = c->gate.estop;
    land_gate_estop(&c->gate);
    answer(c, MAVLINK_MSG_ID_LAND_ESTOP, m.cmd_seq, LAND_RESULT_OK, 0);
    if (!was) {
        land_report_log(c, LAND_SEVERITY_WARNING, "emergency stop latched by command");
    }
}

static void on_release(land_controller *c, const mavlink_message_t *message) {
    mavlink_land_estop_release_t m;
    mavlink_msg_land_estop_release_decode(message, &m);
    uint32_t token;
    const uint8_t result = land_gate_release(&c->gate, m.session, m.step, m.token, c->now_ms, &token);
    answer(c, MAVLINK_MSG_ID_LAND_ESTOP_RELEASE, m.cmd_seq, result, token);
}

static void on_timesync(land_controller *c, const mavlink_message_t *message) {
    mavlink_land_timesync_t m;
    mavlink_msg_land_timesync_decode(message, &m);
    if (m.controller_us != 0) {
        return;  // an answer, not a question
    }
    m.controller_us = (uint64_t)c->now_ms * 1000u;
    land_link_send(&c->link, MAVLINK_MSG_ID_LAND_TIMESYNC, &m, MAVLINK_MSG_ID_LAND_TIMESYNC_LEN);
}

static void on_frame(void *context, const uint8_t *frame) {
    land_controller *c = context;
    if (!land_link_accept(&c->link, frame)) {
        return;
    }
    mavlink_message_t message = {.len = frame[1]};
    memcpy(message.payload64, frame + LAND_FRAME_HEADER, frame[1]);
    switch (land_frame_message(frame)) {
    case MAVLINK_MSG_ID_LAND_HELLO:
        on_hello(c, &message);
        break;
    case MAVLINK_MSG_ID_LAND_HEARTBEAT:
        on_heartbeat(c, &message);
        break;
    case MAVLINK_MSG_ID_LAND_VELOCITY:
        on_velocity(c, &message);
        break;
    case MAVLINK_MSG_ID_LAND_PARAM_READ:
        on_param_read(c, &message);
        break;
    case MAVLINK_MSG_ID_LAND_PARAM_WRITE:
        on_param_write(c, &message);
        break;
    case MAVLINK_MSG_ID_LAND_ESTOP:
        on_estop(c, &message);
        break;
    case MAVLINK_MSG_ID_LAND_ESTOP_RELEASE:
        on_release(c, &message);
        break;
    case MAVLINK_MSG_ID_LAND_TIMESYNC:
        on_timesync(c, &message);
        break;
    default:
        break;  // what only a controller says is not for a controller
    }
}

void land_init(land_controller *c, const land_boot *boot) {
    memset(c, 0, sizeof *c);
    land_gate_init(&c->gate, boot->boot_count, boot->estop);
    c->params = boot->params != NULL ? *boot->params : land_params_default();
    c->reset_cause = boot->reset_cause;
    memcpy(c->serial, boot->serial, LAND_SERIAL_BYTES);
}

void land_receive(land_controller *c, const uint8_t *bytes, size_t length, uint32_t now_ms) {
    c->now_ms = now_ms;
    if (length > 0) {
        land_framer_feed(&c->framer, bytes, length, now_ms, on_frame, c);
    }
    land_checkin_report(&c->checkin, LAND_PART_RECEIVE);
}

static void turn_wheels(land_controller *c, float dt_s) {
    const land_drive *d = &c->gate.drive;
    const land_measure *m = &c->gate.measure;
    if (d->braked) {
        c->left = c->right = land_wheel_resting();
        return;
    }
    land_wheel_step(&c->left, d->left_mps, m->left_mps, c->inputs.left_a, &c->params, dt_s);
    land_wheel_step(&c->right, d->right_mps, m->right_mps, c->inputs.right_a, &c->params, dt_s);
}

land_outputs land_step(land_controller *c, const land_inputs *inputs, uint32_t now_ms) {
    uint32_t step_ms = c->stepped ? now_ms - c->stepped_ms : 0;
    if (step_ms > LAND_STEP_MAX_MS) {
        step_ms = LAND_STEP_MAX_MS;
    }
    const float dt_s = (float)step_ms * 1e-3f;
    c->now_ms = c->stepped_ms = now_ms;
    c->stepped = true;
    c->inputs = *inputs;
    land_gate_tick(&c->gate, inputs, &c->params, now_ms, dt_s);
    turn_wheels(c, dt_s);
    land_checkin_report(&c->checkin, LAND_PART_CONTROL);
    land_report(c);
    return (land_outputs){c->left.duty, c->right.duty, c->gate.drive.braked};
}
