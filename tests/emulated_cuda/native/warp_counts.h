/* Counting of warps, as launches need it. */
#include "device_runtime.h"

/* Before the first lane of a warp runs. */
extern void emu_count_begin(void);
/* After its last; 0 where the log of a lane was not understood to its end. */
extern int emu_count_warp(int lanes);
