// Declarations shared by the HDF5 files of this folder: the handle of a file, and failures that
// quote the cause which the library gives.
#ifndef PM_STORE_HDF5_HANDLE_H
#define PM_STORE_HDF5_HANDLE_H

#include <hdf5.h>

#include "store/hdf5_io.h"

struct pm_hdf5 {
    hid_t file;        // negative once closed
    hid_t access;      // the property list of every access: it refuses links into other files
    bool broken;       // a write has failed: the library is not called for this file any more
    int64_t reserved;  // bytes from the start of the file that the disk holds free for it
    pm_status content; // the code with which readers report wrong content
    char *path;
    char *temporary; // the file that is written until commit; NULL when reading or IN_PLACE
};

// A reader accepts at most this number of attributes of an object, members of a group, or texts of
// an attribute.
#define PM_HDF5_MAX_NAMES 65536
// The bytes of the longest name, with its terminating zero.
#define PM_HDF5_NAME_SIZE 256

// Closes any kind of identifier; a negative one is ignored.
void pm_hdf5_release(hid_t id);

// Fails with the innermost cause that HDF5 gives: "PATH: cannot WHAT OBJECT (cause)".
pm_status pm_hdf5_fail(pm_status code, const char *path, const char *what, const char *object);
// Fails with PM_EFILE: "PATH: cannot write OBJECT (cause)", and marks the file as broken. Objects
// that are open in the file stay open.
pm_status pm_hdf5_fail_write(pm_hdf5 *file, const char *object);
// Fails with PM_ENOMEM.
pm_status pm_hdf5_fail_memory(const char *path);

#endif
