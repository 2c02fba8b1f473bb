// The way out when nothing can be relied on any more.
#pragma once

// Brake, leave a word for the next boot, and boot.
_Noreturn void fault_stop(void);
