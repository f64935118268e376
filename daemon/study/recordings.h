// Compares two recordings (scene/recording.h) bit by bit.
#ifndef PM_STUDY_RECORDINGS_H
#define PM_STUDY_RECORDINGS_H

#include <stdbool.h>

#include "base/status.h"

// Compares all series of two recordings. `difference` [size] becomes "" if they hold the same bits,
// and otherwise one line: the earliest sample at which they differ, with the subsystem or port, the
// variable and both numbers. With `beginning` the second one may be shorter, and is compared with
// the beginning of the first. PM_EFILE: one of them cannot be read; PM_ENOMEM.
pm_status pm_recordings_compare(const char *path_a, const char *path_b, bool beginning,
                                char *difference, int size);

#endif
