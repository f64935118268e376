// Attributes of HDF5 objects: text, integers and numbers, checked before they are read.
#include <stdlib.h>
#include <string.h>

#include "store/hdf5_handle.h"

// Bytes of all texts of an attribute together, far beyond any real attribute.
#define MAX_TEXT ((size_t)1 << 20)

// --- reading attributes ---

typedef struct attribute {
    hid_t id, type, space;
    hssize_t count;
} attribute;

static void attribute_close(attribute *a) {
    pm_hdf5_release(a->space);
    pm_hdf5_release(a->type);
    pm_hdf5_release(a->id);
}

// Opens an attribute of the given type class with at most `capacity` values. The caller closes it
// after PM_OK.
static pm_status attribute_open(const pm_hdf5 *file, const char *object, const char *name,
                                H5T_class_t class, int capacity, attribute *a) {
    *a = (attribute){.type = H5I_INVALID_HID, .space = H5I_INVALID_HID};
    a->id = H5Aopen_by_name(file->file, object, name, H5P_DEFAULT, file->access);
    if (a->id < 0) {
        return pm_fail(file->content, "%s: attribute %s of %s is missing", file->path, name,
                       object);
    }
    a->type = H5Aget_type(a->id);
    a->space = H5Aget_space(a->id);
    a->count = H5Sget_simple_extent_npoints(a->space);
    if (a->type < 0 || H5Tget_class(a->type) != class || a->count < 0 || a->count > capacity) {
        const char *what = class == H5T_STRING    ? "text"
                           : class == H5T_INTEGER ? "integer"
                                                  : "floating-point";
        attribute_close(a);
        return pm_fail(file->content, "%s: attribute %s of %s: expected %s, at most %d value%s",
                       file->path, name, object, what, capacity, capacity == 1 ? "" : "s");
    }
    return PM_OK;
}

// Does the same for exactly one value.
static pm_status attribute_open_one(const pm_hdf5 *file, const char *object, const char *name,
                                    H5T_class_t class, attribute *a) {
    PM_TRY(attribute_open(file, object, name, class, 1, a));
    if (a->count != 1) {
        attribute_close(a);
        return pm_fail(file->content, "%s: attribute %s of %s is empty", file->path, name, object);
    }
    return PM_OK;
}

bool pm_hdf5_is_text(const pm_hdf5 *file, const char *object, const char *name) {
    attribute a;
    if (attribute_open_one(file, object, name, H5T_STRING, &a) != PM_OK) {
        return false;
    }
    attribute_close(&a);
    return true;
}

// Text ends up in messages and paths, so the only control characters may be tabs and line ends.
static bool text_is_printable(const char *text) {
    for (; *text != '\0'; ++text) {
        const unsigned char byte = (unsigned char)*text;
        if ((byte < ' ' && byte != '\n' && byte != '\t') || byte == 0x7f) {
            return false;
        }
    }
    return true;
}

// Makes a type for text of `size` bytes with its terminator, or of H5T_VARIABLE length.
static hid_t memory_text_type(H5T_cset_t letters, size_t size) {
    const hid_t memory = H5Tcopy(H5T_C_S1);
    if (memory >= 0) {
        H5Tset_size(memory, size);
        H5Tset_cset(memory, letters);
    }
    return memory;
}

// Copies all texts of an open attribute into the arena; false if one is unreadable, too long or
// unprintable.
static bool copy_texts(const attribute *a, pm_arena *arena, const char **text) {
    const bool variable = H5Tis_variable_str(a->type) > 0;
    const size_t size = variable ? sizeof(char *) : H5Tget_size(a->type) + 1;
    const size_t count = (size_t)a->count;
    if (size > MAX_TEXT || (count > 0 && size > MAX_TEXT / count)) {
        return false;
    }
    char *buffer = calloc(count + 1, size);
    const hid_t memory = memory_text_type(H5Tget_cset(a->type), variable ? H5T_VARIABLE : size);
    const bool readable = buffer != NULL && memory >= 0 && H5Aread(a->id, memory, buffer) >= 0;
    bool good = readable;
    for (size_t i = 0; good && i < count; ++i) {
        const char *one = buffer + i * size;
        if (variable) {
            memcpy(&one, buffer + i * size, sizeof one);
        }
        one = one == NULL ? "" : one;
        good = strnlen(one, MAX_TEXT) < MAX_TEXT && text_is_printable(one);
        text[i] = good ? pm_arena_strdup(arena, one) : NULL;
        good = text[i] != NULL;
    }
    if (readable && variable) {
        H5Dvlen_reclaim(memory, a->space, H5P_DEFAULT, buffer);
    }
    pm_hdf5_release(memory);
    free(buffer);
    return good;
}

pm_status pm_hdf5_read_texts(const pm_hdf5 *file, const char *object, const char *name,
                             pm_arena *arena, int *count, const char ***text) {
    attribute a;
    PM_TRY(attribute_open(file, object, name, H5T_STRING, PM_HDF5_MAX_NAMES, &a));
    const char **list = pm_arena_array(arena, (size_t)a.count, sizeof *list);
    const bool good = list != NULL && copy_texts(&a, arena, list);
    attribute_close(&a);
    if (!good) {
        return pm_fail(file->content, "%s: attribute %s of %s: text is unreadable or too long",
                       file->path, name, object);
    }
    *count = (int)a.count;
    *text = list;
    return PM_OK;
}

pm_status pm_hdf5_read_text(const pm_hdf5 *file, const char *object, const char *name,
                            pm_arena *arena, const char **text) {
    attribute a;
    PM_TRY(attribute_open_one(file, object, name, H5T_STRING, &a));
    attribute_close(&a);
    int count;
    const char **list;
    PM_TRY(pm_hdf5_read_texts(file, object, name, arena, &count, &list));
    *text = list[0];
    return PM_OK;
}

// Reads the numbers of an open attribute and closes it.
static pm_status read_values(const pm_hdf5 *file, attribute *a, const char *name, hid_t memory,
                             void *value) {
    const pm_status status = H5Aread(a->id, memory, value) < 0
                                 ? pm_hdf5_fail(file->content, file->path, "read attribute", name)
                                 : PM_OK;
    attribute_close(a);
    return status;
}

pm_status pm_hdf5_read_integers(const pm_hdf5 *file, const char *object, const char *name,
                                int capacity, uint64_t *value, int *count) {
    attribute a;
    PM_TRY(attribute_open(file, object, name, H5T_INTEGER, capacity, &a));
    *count = (int)a.count;
    return read_values(file, &a, name, H5T_NATIVE_UINT64, value);
}

pm_status pm_hdf5_read_integer(const pm_hdf5 *file, const char *object, const char *name,
                               uint64_t *value) {
    attribute a;
    PM_TRY(attribute_open_one(file, object, name, H5T_INTEGER, &a));
    return read_values(file, &a, name, H5T_NATIVE_UINT64, value);
}

pm_status pm_hdf5_read_number(const pm_hdf5 *file, const char *object, const char *name,
                              double *value) {
    attribute a;
    PM_TRY(attribute_open_one(file, object, name, H5T_FLOAT, &a));
    return read_values(file, &a, name, H5T_NATIVE_DOUBLE, value);
}

// --- writing attributes ---

// Writes value [count] as an attribute; count < 0 means a scalar.
static pm_status write_attribute(pm_hdf5 *file, const char *object, const char *name, int count,
                                 hid_t stored, hid_t memory, const void *value) {
    const hsize_t extent = count < 0 ? 1 : (hsize_t)count;
    const hid_t space = count < 0 ? H5Screate(H5S_SCALAR) : H5Screate_simple(1, &extent, NULL);
    const hid_t id = H5Acreate_by_name(file->file, object, name, stored, space, H5P_DEFAULT,
                                       H5P_DEFAULT, file->access);
    const bool written = id >= 0 && (extent == 0 || H5Awrite(id, memory, value) >= 0);
    const pm_status status = written ? PM_OK : pm_hdf5_fail_write(file, name);
    pm_hdf5_release(id);
    pm_hdf5_release(space);
    return status;
}

// Writes text of fixed length. The library keeps text of variable length in a heap that it does not
// check, and crashes on a damaged one.
static pm_status write_text_attribute(pm_hdf5 *file, const char *object, const char *name,
                                      int count, const char *const *text) {
    const size_t ntext = count < 0 ? 1 : (size_t)count;
    size_t size = 1;
    for (size_t i = 0; i < ntext; ++i) {
        const size_t length = strlen(text[i]) + 1;
        size = length > size ? length : size;
    }
    char *buffer = calloc(ntext + 1, size);
    if (buffer == NULL) {
        return pm_hdf5_fail_memory(file->path);
    }
    for (size_t i = 0; i < ntext; ++i) {
        strcpy(buffer + i * size, text[i]);
    }
    const hid_t type = memory_text_type(H5T_CSET_UTF8, size);
    const pm_status status = write_attribute(file, object, name, count, type, type, buffer);
    pm_hdf5_release(type);
    free(buffer);
    return status;
}

pm_status pm_hdf5_write_text(pm_hdf5 *file, const char *object, const char *name,
                             const char *text) {
    return write_text_attribute(file, object, name, -1, &text);
}

pm_status pm_hdf5_write_texts(pm_hdf5 *file, const char *object, const char *name, int count,
                              const char *const *text) {
    return write_text_attribute(file, object, name, count, text);
}

pm_status pm_hdf5_write_integers(pm_hdf5 *file, const char *object, const char *name, int count,
                                 const uint64_t *value) {
    return write_attribute(file, object, name, count, H5T_STD_U64LE, H5T_NATIVE_UINT64, value);
}

pm_status pm_hdf5_write_integer(pm_hdf5 *file, const char *object, const char *name,
                                uint64_t value) {
    return write_attribute(file, object, name, -1, H5T_STD_U64LE, H5T_NATIVE_UINT64, &value);
}

pm_status pm_hdf5_write_number(pm_hdf5 *file, const char *object, const char *name, double value) {
    return write_attribute(file, object, name, -1, H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, &value);
}

pm_status pm_hdf5_update_integer(pm_hdf5 *file, const char *object, const char *name,
                                 uint64_t value) {
    const hid_t id = H5Aopen_by_name(file->file, object, name, H5P_DEFAULT, file->access);
    const bool written = id >= 0 && H5Awrite(id, H5T_NATIVE_UINT64, &value) >= 0;
    const pm_status status = written ? PM_OK : pm_hdf5_fail_write(file, name);
    pm_hdf5_release(id);
    return status;
}
