// What goes into the controller from the board's pins, and what comes out to its motors. SI units.
#pragma once

#include <stdbool.h>
#include <stdint.h>

typedef struct {
    float battery_v;
    float current_a;   // from the pack
    float left_a;      // of the left motor, positive while it pushes forward
    float right_a;     // of the right motor
    int32_t left_ticks;
    int32_t right_ticks;
    uint32_t sampled_ms;   // controller time at which the encoders were read
    bool wheel_load;       // suspension switches: the wheels carry the weight
    bool rotors_possible;  // the rotors' supply is on
    bool driver_fault;     // a motor driver says so
    bool estop_pressed;    // the button on the robot
} land_inputs;

// Speed of each wheel that the gate allows; zero and braked unless every condition for motion holds.
typedef struct {
    float left_mps;
    float right_mps;
    bool braked;
} land_drive;

// What the motor stage gets: duty from -1 to 1, positive is forward; braked shorts the motors.
typedef struct {
    float left_duty;
    float right_duty;
    bool braked;
} land_outputs;
