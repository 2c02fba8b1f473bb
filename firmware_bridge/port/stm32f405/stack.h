// The stack's end: painted before `main`, looked at in every turn of the loop.
#pragma once

#include <stdbool.h>
#include <stdint.h>

#define STACK_GUARD_WORDS 32u
#define STACK_PAINT 0x57ACC0DEu

// Whether nothing has ever been written to the lowest words of the stack, the last ones before the end of RAM.
bool stack_holds(void);
