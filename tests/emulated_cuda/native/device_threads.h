/* Launches and their errors, as the checks of memory need them. */
#include "device_runtime.h"
#include <stdlib.h>

#define SHARED_BYTES 262144

extern const char *emu_kernel_name;
extern uint32_t emu_launch_number;
/* Ends the launch with a code of CUDA. */
extern void emu_stop(C *c, int line, const char *why, int code) __attribute__((noreturn));
