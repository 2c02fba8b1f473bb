#include "stack.h"

extern volatile uint32_t stack_begin[];

bool stack_holds(void) {
    for (uint32_t i = 0; i < STACK_GUARD_WORDS; i++) {
        if (stack_begin[i] != STACK_PAINT) {
            return false;
        }
    }
    return true;
}
