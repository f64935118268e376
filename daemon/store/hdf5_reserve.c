// Reserves space on the disk ahead of the HDF5 library, which does not survive a write that fails
// halfway. The reserved space begins at the start of the file and has no gaps.
#include <errno.h>
#include <fcntl.h>
#include <stdint.h>
#include <string.h>
#include <sys/resource.h>

#include "store/hdf5_handle.h"

#define STRIDE (1 << 20) // bytes that are reserved beyond what is asked for, where there is room

// Whether a file of this process may have `size` bytes.
static bool within_limit(int64_t size) {
    struct rlimit limit;
    return getrlimit(RLIMIT_FSIZE, &limit) != 0 || limit.rlim_cur == RLIM_INFINITY ||
           (rlim_t)size <= limit.rlim_cur;
}

// Reserves the bytes up to `end`. Returns 0, or the cause as errno has it.
static int reserve_up_to(pm_hdf5 *file, int descriptor, int64_t end) {
    if (!within_limit(end)) {
        return EFBIG;
    }
    int failed;
    do {
        failed = fallocate(descriptor, FALLOC_FL_KEEP_SIZE, file->reserved, end - file->reserved);
    } while (failed != 0 && errno == EINTR);
    if (failed == 0) {
        file->reserved = end;
    }
    return failed == 0 ? 0 : errno;
}

static bool means_full(int cause) {
    return cause == ENOSPC || cause == EDQUOT || cause == EFBIG;
}

pm_status pm_hdf5_reserve(pm_hdf5 *file, int64_t size) {
    hsize_t end = 0;
    void *handle = NULL;
    if (H5Fget_filesize(file->file, &end) < 0 ||
        H5Fget_vfd_handle(file->file, H5P_DEFAULT, &handle) < 0) {
        return pm_hdf5_fail_write(file, "samples");
    }
    const int64_t needed = (int64_t)end + size;
    if (needed <= file->reserved) {
        return PM_OK;
    }
    const int descriptor = *(const int *)handle;
    int cause = reserve_up_to(file, descriptor, needed + STRIDE);
    if (means_full(cause)) {
        cause = reserve_up_to(file, descriptor, needed);
    }
    return means_full(cause)
               ? pm_fail(PM_EFILE, "%s: cannot write samples (%s)", file->path, strerror(cause))
               : PM_OK;
}
