// How much memory the machine may give to this process.
#ifndef PM_BASE_MEMORY_H
#define PM_BASE_MEMORY_H

#include <stdint.h>

// Returns the number of bytes that this process can still allocate, as far as the system tells: the
// least of the memory that the kernel holds available, what is left of the limit of the control
// group (version 2), and the limit of the process's address space. INT64_MAX: nothing is known.
int64_t pm_memory_available(void);

#endif
