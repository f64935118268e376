// Trying in a child process what may crash in a library that we cannot mend.
#ifndef PM_BASE_ATTEMPT_H
#define PM_BASE_ATTEMPT_H

#include "base/status.h"

// Whether memory is limited: sanitizers reserve more addresses than there is memory.
#if defined(__SANITIZE_ADDRESS__)
#define PM_ATTEMPT_LIMITS_MEMORY 0
#elif defined(__has_feature)
#define PM_ATTEMPT_LIMITS_MEMORY !__has_feature(address_sanitizer)
#else
#define PM_ATTEMPT_LIMITS_MEMORY 1
#endif

// Calls work(context) in a child process, whose results are lost, and waits for it. The child gets
// a while of CPU time, and no more memory than the machine has. PM_OK if it returned; else `code`:
// "<what> (<the signal that ended it>)". PM_ENOMEM: no process. To be called before there are
// threads.
pm_status pm_attempt(void (*work)(const void *context), const void *context, pm_status code,
                     const char *what);

#endif
