// Checks an HDF5 file before the library opens it, because the library crashes on many damaged
// files. Source: HDF5 File Format Specification 2.0; the functions of hdf5_check.c name its
// sections.
//
// The check accepts exactly the part of the format that pm_hdf5_create (hdf5_io.h) uses:
//   superblock      version 0; 8-byte addresses and lengths; the default node sizes of B-trees
//   groups          version 1 B-trees, symbol table nodes and local heaps; at most 4 nested groups;
//                   no soft or external links
//   object headers  version 1, with continuation blocks; messages for dataspace, datatype, fill
//                   value, layout, attribute and time of change only
//   datasets        contiguous; rank at most 4 and at most 2^28 values; no filters
//   datatypes       IEEE floats of 4 or 8 bytes, integers of 1, 2, 4 or 8 bytes, text of fixed
//                   length, all little-endian
//   attributes      version 1, of these datatypes
// Every structure must lie within the file and apart from all others, and the sizes that describe
// the same thing in several places must agree.
#ifndef PM_STORE_HDF5_CHECK_H
#define PM_STORE_HDF5_CHECK_H

#include <stddef.h>

// Checks data [size], the bytes of a whole file. Returns NULL if the file passes; otherwise a
// clause that says what is wrong, such as "parts of it overlap" or "out of memory".
const char *pm_hdf5_check(const void *data, size_t size);

#endif
