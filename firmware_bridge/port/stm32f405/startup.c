// From reset to main: vectors, memory, floating point; and what happens when the processor faults.
#include <stdint.h>

#include "board.h"
#include "fault.h"
#include "keep.h"
#include "registers.h"
#include "stack.h"
#include "usart.h"

extern uint32_t data_begin[], data_end[], data_load[], bss_begin[], bss_end[], stack_begin[], stack_top[];

int main(void);
void reset_handler(void);
static void fault_handler(void);
static void systick_handler(void);

#define STACK_IN_USE_WORDS 32u  // of `reset_handler` itself, with room to spare

volatile uint32_t systick_count;

typedef void (*handler)(void);

// An interrupt that is left out here is not enabled; if it came all the same, it would be a fault.
__attribute__((section(".vectors"), used)) static const struct {
    uint32_t *stack;
    handler system[15];
    handler interrupts[82];
} VECTORS = {
    .stack = stack_top,
    .system =
        {
            [0] = reset_handler,
            [1] = fault_handler,  // NMI
            [2] = fault_handler,  // hard fault; the others end there as well
            [14] = systick_handler,
        },
    .interrupts =
        {
            [IRQ_USART1] = usart1_interrupt,
            [IRQ_USART2] = usart2_interrupt,
        },
};

void reset_handler(void) {
    SCB_VTOR = (uint32_t)(uintptr_t)&VECTORS;  // after DFU the boot loader's own vectors still lie at address 0
    SCB_CPACR |= 0xFu << 20;  // the floating-point unit, before anything uses it
    __asm volatile("dsb\n isb");
    const uint32_t *from = data_load;
    for (uint32_t *to = data_begin; to < data_end; to++) {
        *to = *from++;
    }
    for (uint32_t *to = bss_begin; to < bss_end; to++) {
        *to = 0;
    }
    uint32_t *const in_use = __builtin_frame_address(0);
    for (uint32_t *to = stack_begin; to < in_use - STACK_IN_USE_WORDS; to++) {
        *to = STACK_PAINT;
    }
    (void)main();
}

static void systick_handler(void) {
    systick_count++;
}

// The stack may be what is wrong: begin a new one.
__attribute__((naked)) static void fault_handler(void) {
    __asm volatile("ldr r0, =stack_top\n mov sp, r0\n b fault_stop");
}

__attribute__((used)) _Noreturn void fault_stop(void) {
    board_brake();
    keep_note_fault();
    SCB_AIRCR = 0x05FA0004;
    for (;;) {
    }
}
