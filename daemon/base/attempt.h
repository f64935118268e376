// An attempt runs work in a child process because the work may crash: the HDF5 library, for
// example, does not survive every damaged file.
#ifndef PM_BASE_ATTEMPT_H
#define PM_BASE_ATTEMPT_H

#include "base/status.h"

// True if an attempt limits its memory. Address sanitizers reserve more addresses than the machine
// has memory, so under them there is no limit.
#if defined(__SANITIZE_ADDRESS__)
#define PM_ATTEMPT_LIMITS_MEMORY 0
#elif defined(__has_feature)
#define PM_ATTEMPT_LIMITS_MEMORY !__has_feature(address_sanitizer)
#else
#define PM_ATTEMPT_LIMITS_MEMORY 1
#endif

// Calls work(context) in a child process and waits for the child; the results of the work are lost.
// The child may use 20 s of CPU time and as much memory as the machine has. Returns PM_OK if the
// work returned. If a signal ended the child, returns `code` and describes it as "<what>
// (<signal>)". PM_ENOMEM: no process could be started. The caller must have no threads yet.
pm_status pm_attempt(void (*work)(const void *context), const void *context, pm_status code,
                     const char *what);

#endif
