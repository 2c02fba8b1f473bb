// The chip's own pins; firmware_bridge/README.md has the table and the wiring.
#include "board.h"
#include "registers.h"

#define PWM_STEPS 8400u  // 168 MHz / 20 kHz

// What an analogue input of 3.3 V means; change these with the board's resistors.
#define ADC_FULL 4095.0f
#define BATTERY_V (3.3f * 11.0f)    // divider of 100 and 10 kiloohm
#define PACK_A (3.3f / 0.100f)      // sensor with 100 mV/A
#define MOTOR_A (3.3f / 0.200f)     // driver's current output with 200 mV/A, without a sign

enum { INPUT, OUTPUT, ALTERNATE, ANALOGUE };
enum { FLOATING, PULL_UP };

static int32_t left_ticks, right_ticks;
static uint16_t left_last, right_last;
static float left_sign = 1.0f, right_sign = 1.0f;  // of the duty: the drivers report magnitudes

static void pin(gpio_registers *g, uint32_t n, uint32_t mode, uint32_t pull, uint32_t function) {
    volatile uint32_t *alternate = n < 8 ? &g->AFRL : &g->AFRH;
    const uint32_t nibble = 4 * (n % 8);
    *alternate = (*alternate & ~(0xFu << nibble)) | function << nibble;
    g->PUPDR = (g->PUPDR & ~(3u << 2 * n)) | pull << 2 * n;
    g->MODER = (g->MODER & ~(3u << 2 * n)) | mode << 2 * n;
}

// Count both edges of both channels: four a line.
static void encoder_init(timer_registers *t) {
    t->SMCR = 3u;
    t->CCMR1 = 1u | 0xFu << 4 | 1u << 8 | 0xFu << 12;  // both inputs, eight samples at f/32
    t->CCER = 0;
    t->ARR = 0xFFFF;
    t->CR1 = TIM_CR1_CEN;
}

static void pwm_init(void) {
    TIM8->ARR = PWM_STEPS - 1;
    TIM8->CCMR1 = TIM8->CCMR2 = 6u << 4 | 1u << 3 | 6u << 12 | 1u << 11;  // PWM mode 1, preloaded
    for (int i = 0; i < 4; i++) {
        TIM8->CCR[i] = PWM_STEPS;  // both inputs of both drivers high: brake
    }
    TIM8->CCER = 0x1111;
    TIM8->EGR = TIM_EGR_UG;
    TIM8->BDTR = TIM_BDTR_MOE;
    TIM8->CR1 = TIM_CR1_CEN | TIM_CR1_ARPE;
}

static void adc_init(void) {
    ADC_CCR = 1u << 16;  // 84 MHz / 4
    ADC1->CR1 = ADC_CR1_SCAN;
    ADC1->SMPR2 = 4u << 12 | 4u << 15 | 4u << 18 | 4u << 21;  // 84 cycles for channels 4 to 7
    ADC1->JSQR = 3u << 20 | 4u | 5u << 5 | 6u << 10 | 7u << 15;
    ADC1->CR2 = ADC_CR2_ADON;
    ADC1->CR2 |= ADC_CR2_JSWSTART;
}

void pins_init(void) {
    clock_to(&RCC_AHB1ENR, RCC_AHB1_GPIOA | RCC_AHB1_GPIOB | RCC_AHB1_GPIOC);
    clock_to(&RCC_APB1ENR, RCC_APB1_TIM3 | RCC_APB1_TIM4);
    clock_to(&RCC_APB2ENR, RCC_APB2_TIM8 | RCC_APB2_ADC1 | RCC_APB2_USART1);
    pwm_init();  // before its pins are connected: they come up braking
    pin(GPIOC, 6, ALTERNATE, FLOATING, 3);
    pin(GPIOC, 7, ALTERNATE, FLOATING, 3);
    pin(GPIOC, 8, ALTERNATE, FLOATING, 3);
    pin(GPIOC, 9, ALTERNATE, FLOATING, 3);
    pin(GPIOA, 9, ALTERNATE, FLOATING, 7);
    pin(GPIOA, 10, ALTERNATE, PULL_UP, 7);
    pin(GPIOB, 4, ALTERNATE, PULL_UP, 2);
    pin(GPIOB, 5, ALTERNATE, PULL_UP, 2);
    pin(GPIOB, 6, ALTERNATE, PULL_UP, 2);
    pin(GPIOB, 7, ALTERNATE, PULL_UP, 2);
    encoder_init(TIM3);
    encoder_init(TIM4);
    for (uint32_t n = 4; n < 8; n++) {
        pin(GPIOA, n, ANALOGUE, FLOATING, 0);
    }
    adc_init();
    for (uint32_t n = 0; n < 4; n++) {
        pin(GPIOC, n, INPUT, PULL_UP, 0);
    }
    pin(GPIOB, 1, INPUT, PULL_UP, 0);
    GPIOB->BSRR = 1u;  // wake the drivers
    pin(GPIOB, 0, OUTPUT, FLOATING, 0);
}

static int32_t counted(timer_registers *t, uint16_t *last, int32_t ticks) {
    const uint16_t now = (uint16_t)t->CNT;
    const int16_t step = (int16_t)(uint16_t)(now - *last);
    *last = now;
    return (int32_t)((uint32_t)ticks + (uint32_t)(int32_t)step);
}

static float measured(int n, float full) {
    return (float)(ADC1->JDR[n] & 0xFFFu) * (full / ADC_FULL);
}

bool pins_sample(land_inputs *in, uint32_t now_ms) {
    const bool converted = (ADC1->SR & ADC_SR_JEOC) != 0;
    const uint32_t c = GPIOC->IDR;
    left_ticks = counted(TIM3, &left_last, left_ticks);
    right_ticks = counted(TIM4, &right_last, right_ticks);
    *in = (land_inputs){
        .battery_v = measured(0, BATTERY_V),
        .current_a = measured(1, PACK_A),
        .left_a = left_sign * measured(2, MOTOR_A),
        .right_a = right_sign * measured(3, MOTOR_A),
        .left_ticks = left_ticks,
        .right_ticks = right_ticks,
        .sampled_ms = now_ms,
        // A wire that comes off reads high, and high is always the safe answer.
        .wheel_load = (c & 3u) == 0,
        .rotors_possible = (c & 4u) != 0,
        .estop_pressed = (c & 8u) != 0,
        .driver_fault = (GPIOB->IDR & 2u) == 0,
    };
    ADC1->SR = 0;
    ADC1->CR2 |= ADC_CR2_JSWSTART;
    return converted;
}

// Drive and brake in turn (slow decay): one input high, the other low for the share of the duty.
static void bridge(int first, float duty, bool braked) {
    const float size = duty < 0.0f ? -duty : duty;
    const uint32_t pulsed = PWM_STEPS - (uint32_t)(size * (float)PWM_STEPS);
    const bool forward = duty >= 0.0f;
    TIM8->CCR[first] = braked || forward ? PWM_STEPS : pulsed;
    TIM8->CCR[first + 1] = braked || !forward ? PWM_STEPS : pulsed;
}

void pins_drive(const land_outputs *out) {
    left_sign = out->left_duty < 0.0f ? -1.0f : 1.0f;
    right_sign = out->right_duty < 0.0f ? -1.0f : 1.0f;
    bridge(0, out->left_duty, out->braked);
    bridge(2, out->right_duty, out->braked);
}
