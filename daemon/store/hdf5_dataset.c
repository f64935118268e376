// Groups, datasets and growing series in HDF5 files.
#include <string.h>

#include "base/memory.h"
#include "store/hdf5_handle.h"

// The most values of a dataset: 2 GiB as double.
#define MAX_VALUES ((hsize_t)1 << 28)
// From this number of values on, storing them in half the space is worth the check.
#define WORTH_FLOATS 1024

// --- groups and datasets ---

// Link creation that makes missing parent groups.
static hid_t with_parents(void) {
    const hid_t list = H5Pcreate(H5P_LINK_CREATE);
    if (list >= 0) {
        H5Pset_create_intermediate_group(list, 1);
    }
    return list;
}

pm_status pm_hdf5_write_group(pm_hdf5 *file, const char *name) {
    const hid_t list = with_parents();
    const hid_t id = H5Gcreate2(file->file, name, list, H5P_DEFAULT, H5P_DEFAULT);
    const pm_status status = id < 0 ? pm_hdf5_fail_write(file, name) : PM_OK;
    pm_hdf5_release(id);
    pm_hdf5_release(list);
    return status;
}

// Returns true if the numbers lie in this very file, as floats of 4 or 8 bytes or, in data, which
// any tool may have written, as integers.
static bool storage_is_plain(const pm_hdf5 *file, hid_t id) {
    const hid_t type = H5Dget_type(id);
    const hid_t list = H5Dget_create_plist(id);
    const size_t size = type < 0 ? 0 : H5Tget_size(type);
    const H5T_class_t class = type < 0 ? H5T_NO_CLASS : H5Tget_class(type);
    const bool number = (class == H5T_FLOAT && (size == 4 || size == 8)) ||
                        (class == H5T_INTEGER && file->content == PM_EDATA);
    const bool plain = list >= 0 && number && H5Pget_external_count(list) == 0 &&
                       H5Pget_layout(list) != H5D_VIRTUAL;
    pm_hdf5_release(list);
    pm_hdf5_release(type);
    return plain;
}

// Gives extent [rank] of an open dataset; false if its rank differs or an extent is out of bounds.
static bool bounded_extents(hid_t id, int rank, int *extent) {
    hsize_t size[PM_HDF5_MAX_RANK] = {0}, total = 1;
    const hid_t space = H5Dget_space(id);
    bool good = space >= 0 && H5Sget_simple_extent_type(space) != H5S_NULL &&
                H5Sget_simple_extent_ndims(space) == rank &&
                H5Sget_simple_extent_dims(space, size, NULL) >= 0;
    for (int i = 0; good && i < rank; ++i) {
        good = size[i] >= 1 && size[i] <= MAX_VALUES / total;
        total *= good ? size[i] : 1;
        extent[i] = good ? (int)size[i] : 0;
    }
    pm_hdf5_release(space);
    return good;
}

static pm_status dataset_open(const pm_hdf5 *file, const char *name, int rank, int *extent,
                              hid_t *dataset) {
    const hid_t id = H5Oopen(file->file, name, file->access);
    if (id < 0 || H5Iget_type(id) != H5I_DATASET) {
        pm_hdf5_release(id);
        return pm_fail(file->content, "%s: dataset %s is missing", file->path, name);
    }
    if (!storage_is_plain(file, id)) {
        pm_hdf5_release(id);
        return pm_fail(file->content, "%s: dataset %s: expected float64 or float32 numbers",
                       file->path, name);
    }
    if (!bounded_extents(id, rank, extent)) {
        pm_hdf5_release(id);
        return pm_fail(file->content,
                       "%s: dataset %s: expected %d dimensions, none of them empty, and at most "
                       "%llu values",
                       file->path, name, rank, (unsigned long long)MAX_VALUES);
    }
    *dataset = id;
    return PM_OK;
}

bool pm_hdf5_has(const pm_hdf5 *file, const char *name) {
    return H5Lexists(file->file, name, H5P_DEFAULT) > 0;
}

pm_status pm_hdf5_shape(const pm_hdf5 *file, const char *name, int rank, int *extent) {
    hid_t id = H5I_INVALID_HID;
    PM_TRY(dataset_open(file, name, rank, extent, &id));
    pm_hdf5_release(id);
    int64_t size = (int64_t)sizeof(double);
    for (int i = 0; i < rank; ++i) {
        size *= extent[i];
    }
    const int64_t available = pm_memory_available();
    return size <= available
               ? PM_OK
               : pm_fail(PM_ENOMEM,
                         "%s: dataset %s takes %.3g MB of memory, and %.3g MB are available",
                         file->path, name, 1e-6 * (double)size, 1e-6 * (double)available);
}

pm_status pm_hdf5_read(const pm_hdf5 *file, const char *name, int rank, const int *extent,
                       double *value) {
    int found[PM_HDF5_MAX_RANK];
    hid_t id = H5I_INVALID_HID;
    PM_TRY(dataset_open(file, name, rank, found, &id));
    pm_status status = PM_OK;
    for (int i = 0; i < rank && status == PM_OK; ++i) {
        if (found[i] != extent[i]) {
            status = pm_fail(file->content, "%s: dataset %s: dimension %d is %d, expected %d",
                             file->path, name, i + 1, found[i], extent[i]);
        }
    }
    if (status == PM_OK &&
        H5Dread(id, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, value) < 0) {
        status = pm_hdf5_fail(file->content, file->path, "read", name);
    }
    pm_hdf5_release(id);
    return status;
}

pm_status pm_hdf5_read_row(const pm_hdf5 *file, const char *name, int row, int extent,
                           double *value) {
    const hsize_t start[2] = {(hsize_t)row, 0}, block[2] = {1, (hsize_t)extent};
    hsize_t size[2] = {0, 0};
    const hid_t id = H5Dopen2(file->file, name, H5P_DEFAULT);
    const hid_t space = id < 0 ? H5I_INVALID_HID : H5Dget_space(id);
    const hid_t memory = H5Screate_simple(2, block, NULL);
    const bool good = space >= 0 && storage_is_plain(file, id) &&
                      H5Sget_simple_extent_ndims(space) == 2 &&
                      H5Sget_simple_extent_dims(space, size, NULL) == 2 && start[0] < size[0] &&
                      block[1] == size[1] &&
                      H5Sselect_hyperslab(space, H5S_SELECT_SET, start, NULL, block, NULL) >= 0 &&
                      H5Dread(id, H5T_NATIVE_DOUBLE, memory, space, H5P_DEFAULT, value) >= 0;
    pm_hdf5_release(memory);
    pm_hdf5_release(space);
    pm_hdf5_release(id);
    return good ? PM_OK
                : pm_fail(file->content, "%s: %s: expected a row %d of %d numbers", file->path,
                          name, row, extent);
}

// Dataset creation without the time of writing, so that equal content makes equal files.
static hid_t without_times(void) {
    const hid_t list = H5Pcreate(H5P_DATASET_CREATE);
    H5Pset_obj_track_times(list, false);
    return list;
}

// Returns true if there are at least WORTH_FLOATS numbers and 4 bytes hold each of them exactly.
static bool are_floats(size_t count, const double *value) {
    size_t i = 0;
    while (i < count && (double)(float)value[i] == value[i]) {
        ++i;
    }
    return i == count && count >= WORTH_FLOATS;
}

pm_status pm_hdf5_write(pm_hdf5 *file, const char *name, int rank, const int *extent,
                        const double *value) {
    hsize_t size[PM_HDF5_MAX_RANK];
    size_t count = 1;
    for (int i = 0; i < rank; ++i) {
        size[i] = (hsize_t)extent[i];
        count *= (size_t)extent[i];
    }
    const hid_t parents = with_parents(), list = without_times();
    const hid_t space = rank == 0 ? H5Screate(H5S_SCALAR) : H5Screate_simple(rank, size, NULL);
    const hid_t type = are_floats(count, value) ? H5T_IEEE_F32LE : H5T_IEEE_F64LE;
    const hid_t id = H5Dcreate2(file->file, name, type, space, parents, list, H5P_DEFAULT);
    // The library keeps small datasets in memory, and writes them when they are closed.
    const bool written =
        id >= 0 && H5Dwrite(id, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, value) >= 0 &&
        H5Dclose(id) >= 0;
    const pm_status status = written ? PM_OK : pm_hdf5_fail_write(file, name);
    pm_hdf5_release(space);
    pm_hdf5_release(list);
    pm_hdf5_release(parents);
    return status;
}

// --- series ---

// Dataset access that keeps only the last chunk in memory. By default the library keeps a mebibyte
// of each dataset, and a recording has a dataset for each quantity of each part.
static hid_t with_one_chunk(const pm_hdf5_series *series, int chunk) {
    size_t size = (size_t)chunk * sizeof(double);
    for (int i = 0; i < series->rank; ++i) {
        size *= (size_t)series->extent[i];
    }
    const hid_t list = H5Pcreate(H5P_DATASET_ACCESS);
    H5Pset_chunk_cache(list, 1, size, H5D_CHUNK_CACHE_W0_DEFAULT);
    return list;
}

static pm_hdf5_series make_series(pm_hdf5 *file, int rank, const int *extent) {
    pm_hdf5_series series = {.file = file, .rank = rank};
    for (int i = 0; i < rank; ++i) {
        series.extent[i] = extent[i];
    }
    return series;
}

// Writes the extents of `count` samples to size [1 + PM_HDF5_SERIES_RANK].
static void set_size(const pm_hdf5_series *series, hsize_t count, hsize_t *size) {
    size[0] = count;
    for (int i = 0; i < series->rank; ++i) {
        size[1 + i] = (hsize_t)series->extent[i];
    }
}

pm_status pm_hdf5_series_create(pm_hdf5_series *series, pm_hdf5 *file, const char *name, int rank,
                                const int *extent, int chunk, bool integer) {
    hsize_t size[1 + PM_HDF5_SERIES_RANK], limit[1 + PM_HDF5_SERIES_RANK],
        piece[1 + PM_HDF5_SERIES_RANK];
    *series = make_series(file, rank, extent);
    set_size(series, 0, size);
    set_size(series, H5S_UNLIMITED, limit);
    set_size(series, (hsize_t)chunk, piece);
    const hid_t parents = with_parents(), list = without_times();
    const hid_t access = with_one_chunk(series, chunk);
    const hid_t space = H5Screate_simple(1 + rank, size, limit);
    H5Pset_chunk(list, 1 + rank, piece);
    series->id = H5Dcreate2(file->file, name, integer ? H5T_STD_I64LE : H5T_IEEE_F64LE, space,
                            parents, list, access);
    const pm_status status = series->id < 0 ? pm_hdf5_fail_write(file, name) : PM_OK;
    pm_hdf5_release(list);
    pm_hdf5_release(access);
    pm_hdf5_release(space);
    pm_hdf5_release(parents);
    return status;
}

// Returns true if a space is that of a series with at least as many samples as kept[0].
static bool space_fits(hid_t space, int rank, const hsize_t *kept) {
    hsize_t size[1 + PM_HDF5_SERIES_RANK];
    if (space < 0 || H5Sget_simple_extent_ndims(space) != rank ||
        H5Sget_simple_extent_dims(space, size, NULL) != rank || size[0] < kept[0]) {
        return false;
    }
    return memcmp(size + 1, kept + 1, (size_t)(rank - 1) * sizeof *size) == 0;
}

pm_status pm_hdf5_series_open(pm_hdf5_series *series, pm_hdf5 *file, const char *name, int rank,
                              const int *extent, int chunk, int64_t count) {
    hsize_t kept[1 + PM_HDF5_SERIES_RANK];
    *series = make_series(file, rank, extent);
    set_size(series, (hsize_t)count, kept);
    const hid_t access = with_one_chunk(series, chunk);
    series->id = H5Dopen2(file->file, name, access);
    series->count = count;
    const hid_t space = series->id < 0 ? H5I_INVALID_HID : H5Dget_space(series->id);
    const bool fits = space_fits(space, 1 + rank, kept);
    pm_hdf5_release(space);
    pm_hdf5_release(access);
    if (!fits || H5Dset_extent(series->id, kept) < 0) {
        pm_hdf5_release(series->id);
        return pm_fail(PM_EFILE, "%s: %s: expected a series of %lld samples to go on with",
                       file->path, name, (long long)count);
    }
    return PM_OK;
}

pm_status pm_hdf5_series_append(pm_hdf5_series *series, int count, const double *value) {
    const int rank = 1 + series->rank;
    const hsize_t start[1 + PM_HDF5_SERIES_RANK] = {(hsize_t)series->count};
    hsize_t block[1 + PM_HDF5_SERIES_RANK], size[1 + PM_HDF5_SERIES_RANK];
    set_size(series, (hsize_t)count, block);
    set_size(series, start[0] + (hsize_t)count, size);
    hid_t space = H5I_INVALID_HID;
    const hid_t memory = H5Screate_simple(rank, block, NULL);
    bool written = memory >= 0 && H5Dset_extent(series->id, size) >= 0;
    if (written) {
        space = H5Dget_space(series->id);
        written = space >= 0 &&
                  H5Sselect_hyperslab(space, H5S_SELECT_SET, start, NULL, block, NULL) >= 0 &&
                  H5Dwrite(series->id, H5T_NATIVE_DOUBLE, memory, space, H5P_DEFAULT, value) >= 0;
    }
    const pm_status status = written ? PM_OK : pm_hdf5_fail_write(series->file, "samples");
    pm_hdf5_release(space);
    pm_hdf5_release(memory);
    series->count += written ? count : 0;
    return status;
}
