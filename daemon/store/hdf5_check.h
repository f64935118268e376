// Looks through an HDF5 file before the library does, which crashes on many a damaged one. Only
// that part of the format passes which files written here are made of: superblock 0, old-style
// groups, version 1 object headers, contiguous datasets and attributes of plain numbers and
// fixed-length text. All of these must lie within the file, apart from each other, and agree about
// their sizes. Source: HDF5 File Format Specification 2.0, whose sections the functions name.
#ifndef PM_STORE_HDF5_CHECK_H
#define PM_STORE_HDF5_CHECK_H

#include <stddef.h>

// NULL if the whole file is such; else half a sentence about what is not. data: [size]. "out of
// memory" is possible.
const char *pm_hdf5_check(const void *data, size_t size);

#endif
