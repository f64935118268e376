// Walks through all objects of an HDF5 file, from the superblock on. The walk follows an address or
// a size only after it has checked it, and ends at the first objection.
#include "store/hdf5_check.h"

#include <endian.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#define UNDEFINED UINT64_MAX // the address of nothing
#define LEAF_K 4             // the library's default: half the symbols of a symbol table node
#define INTERNAL_K 16        // the library's default: half the children of a B-tree node
#define MAX_DEPTH 4          // of nested groups
#define MAX_LEVEL 8          // of B-trees
#define MAX_RANK 4
#define MAX_VALUES (UINT64_C(1) << 28) // of a dataset or attribute, as in hdf5_io.c
#define MAX_EXTENTS 65536              // structures of a file
#define MAX_BLOCKS 256                 // of messages in one object

#define SUPERBLOCK_SIZE 96
#define ENTRY_SIZE 40 // of a symbol
#define TREE_SIZE (24 + 8 * (4 * INTERNAL_K + 1))
#define NODE_SIZE (8 + 2 * LEAF_K * ENTRY_SIZE)
#define HEAP_SIZE 32
#define HEADER_SIZE 16 // of an object header
#define MESSAGE_SIZE 8 // of a message without its content

// The bytes [from, to) that one structure takes.
typedef struct byte_range {
    uint64_t from, to;
} byte_range;

typedef struct file_walk {
    const unsigned char *data;
    uint64_t size, claimed; // bytes
    const char *objection;  // NULL: none so far
    int count, capacity;
    byte_range *extent; // [count]
} file_walk;

// The local heap of a group, which holds the names of its members.
typedef struct name_heap {
    const unsigned char *text;
    uint64_t size;
} name_heap;

// The facts that the messages of an object header have stated.
typedef struct object_facts {
    bool space, type, layout, group;
    uint64_t values, value_size; // values of the dataspace; bytes of one value
    uint64_t stored;             // bytes that the layout reserves
    uint64_t tree, names;        // addresses of the group's B-tree and heap
    int messages, blocks;
} object_facts;

// Notes an objection unless there is one already. Returns false, so that checks can return it.
static bool object_to(file_walk *w, const char *objection) {
    if (w->objection == NULL) {
        w->objection = objection;
    }
    return false;
}

// --- bytes ---

// Reads a little-endian number of `size` bytes.
static uint64_t number(const unsigned char *at, int size) {
    uint64_t value = 0;
    for (int i = size - 1; i >= 0; --i) {
        value = value << 8 | at[i];
    }
    return value;
}

static bool lies_within(const file_walk *w, uint64_t address, uint64_t size) {
    return address <= w->size && size <= w->size - address;
}

// Reserves the bytes of a structure, which no other structure may share, and returns them; NULL if
// they lie beyond the end of the file. All claims together must fit the file, so that a walk ends
// even if the structures refer to each other in a circle.
static const unsigned char *claim(file_walk *w, uint64_t address, uint64_t size) {
    if (!lies_within(w, address, size)) {
        object_to(w, "a structure lies beyond its end");
        return NULL;
    }
    w->claimed += size;
    if (w->claimed > w->size || w->count == MAX_EXTENTS) {
        object_to(w, "parts of it overlap, or there are too many");
        return NULL;
    }
    if (w->count == w->capacity) {
        const int capacity = 2 * w->capacity + 64;
        byte_range *larger = realloc(w->extent, (size_t)capacity * sizeof *larger);
        if (larger == NULL) {
            object_to(w, "out of memory");
            return NULL;
        }
        w->extent = larger;
        w->capacity = capacity;
    }
    w->extent[w->count++] = (byte_range){address, address + size};
    return w->data + address;
}

static int compare_extents(const void *a, const void *b) {
    const byte_range *x = a, *y = b;
    return x->from < y->from ? -1 : x->from > y->from;
}

// --- datatypes (IV.A.2.d), dataspaces (IV.A.2.b) ---

// Returns the bytes of one value of a datatype; 0 if the type is not accepted.
static uint64_t type_size(const unsigned char *type, uint64_t size) {
    static const unsigned char float64[20] = {0x11, 0x20, 63, 0,  8, 0,  0,    0, 0, 0,
                                              64,   0,    52, 11, 0, 52, 0xff, 3, 0, 0};
    static const unsigned char float32[20] = {0x11, 0x20, 31, 0, 4, 0,  0,   0, 0, 0,
                                              32,   0,    23, 8, 0, 23, 127, 0, 0, 0};
    if (size >= 20 && memcmp(type, float64, 20) == 0) {
        return 8;
    }
    if (size >= 20 && memcmp(type, float32, 20) == 0) {
        return 4;
    }
    if (size < 8) {
        return 0;
    }
    const uint64_t bytes = number(type + 4, 4);
    const bool integer = size >= 12 && type[0] == 0x10 && (type[1] & ~0x08) == 0 && type[2] == 0 &&
                         type[3] == 0 && (bytes == 1 || bytes == 2 || bytes == 4 || bytes == 8) &&
                         number(type + 8, 2) == 0 && number(type + 10, 2) == 8 * bytes;
    const bool text = type[0] == 0x13 && (type[1] & 0x0f) <= 2 && type[1] >> 4 <= 1 &&
                      type[2] == 0 && type[3] == 0 && bytes >= 1 && bytes <= 65536;
    return integer || text ? bytes : 0;
}

// Counts the values of a dataspace; false if it is damaged or too large.
static bool space_values(const unsigned char *space, uint64_t size, uint64_t *values) {
    if (size < 8 || space[0] != 1 || space[1] > MAX_RANK || space[2] > 1) {
        return false;
    }
    const int rank = space[1], limits = space[2];
    if (size < 8 + 8 * (uint64_t)(rank + rank * limits)) {
        return false;
    }
    *values = 1;
    for (int i = 0; i < rank; ++i) {
        const uint64_t length = number(space + 8 + 8 * i, 8);
        if (length > MAX_VALUES || *values * length > MAX_VALUES) {
            return false;
        }
        *values *= length;
        if (limits == 1 && number(space + 8 + 8 * (rank + i), 8) < length) {
            return false;
        }
    }
    return true;
}

// --- messages of an object header (IV.A.2) ---

static uint64_t padded(uint64_t size) {
    return (size + 7) / 8 * 8;
}

static bool check_attribute(file_walk *w, const unsigned char *at, uint64_t size) {
    if (size < 8 || at[0] != 1) {
        return object_to(w, "an attribute has another version");
    }
    const uint64_t name_size = number(at + 2, 2), type = number(at + 4, 2),
                   space = number(at + 6, 2);
    const uint64_t head = 8 + padded(name_size) + padded(type) + padded(space);
    if (head > size) {
        return object_to(w, "an attribute is truncated");
    }
    const unsigned char *name = at + 8;
    if (name_size < 2 || strnlen((const char *)name, name_size) + 1 != name_size) {
        return object_to(w, "an attribute's name is damaged");
    }
    uint64_t values;
    const unsigned char *type_at = name + padded(name_size);
    const uint64_t bytes = type_size(type_at, type);
    if (bytes == 0 || !space_values(type_at + padded(type), space, &values)) {
        return object_to(w, "an attribute is not of plain numbers or text");
    }
    return values * bytes <= size - head || object_to(w, "an attribute is truncated");
}

// Objects to the second message of a kind.
static bool is_new(file_walk *w, bool *seen) {
    const bool new = !*seen;
    *seen = true;
    return new || object_to(w, "an object repeats a message");
}

static bool check_block(file_walk *w, object_facts *o, uint64_t address, uint64_t size);

static bool check_message(file_walk *w, object_facts *o, int type, const unsigned char *at,
                          uint64_t size) {
    switch (type) {
    case 0x00: // a gap between messages
        return true;
    case 0x01: // dataspace
        return is_new(w, &o->space) &&
               (space_values(at, size, &o->values) || object_to(w, "a dataspace is damaged"));
    case 0x03: // datatype
        o->value_size = type_size(at, size);
        return is_new(w, &o->type) &&
               (o->value_size > 0 || object_to(w, "a dataset is not of plain numbers or text"));
    case 0x05: // fill value
        // Only one that is undefined or has no bytes.
        return (size >= 4 && at[0] == 2 && at[1] <= 3 && at[2] <= 2 &&
                (at[3] == 0 || (at[3] == 1 && size >= 8 && number(at + 4, 4) == 0))) ||
               object_to(w, "a fill value is of a kind that is not accepted");
    case 0x08: // data layout
        if (!is_new(w, &o->layout)) {
            return false;
        }
        if (size < 18 || at[0] != 3 || at[1] != 1) {
            return object_to(w, "a dataset is not contiguous");
        }
        o->stored = number(at + 10, 8);
        return claim(w, number(at + 2, 8), o->stored) != NULL;
    case 0x0c: // attribute
        return check_attribute(w, at, size);
    case 0x10: // continuation block
        return size >= 16 ? check_block(w, o, number(at, 8), number(at + 8, 8))
                          : object_to(w, "an object is truncated");
    case 0x11: // symbol table of a group
        if (size < 16) {
            return object_to(w, "a group is truncated");
        }
        o->tree = number(at, 8);
        o->names = number(at + 8, 8);
        return is_new(w, &o->group);
    case 0x12: // time of modification
        return (size >= 8 && at[0] == 1) || object_to(w, "a time has another version");
    default:
        return object_to(w, "it uses features of HDF5 that files of portmet do not use");
    }
}

// Checks a block of messages, which must fill it.
static bool check_block(file_walk *w, object_facts *o, uint64_t address, uint64_t size) {
    if (++o->blocks > MAX_BLOCKS) {
        return object_to(w, "a part of an object is damaged");
    }
    const unsigned char *at = claim(w, address, size);
    if (at == NULL) {
        return false;
    }
    while (size > 0) {
        if (size < MESSAGE_SIZE) {
            return object_to(w, "an object is truncated");
        }
        const uint64_t content = number(at + 2, 2);
        if (content > size - MESSAGE_SIZE || content % 8 != 0 || (at[4] & ~1) != 0) {
            return object_to(w, "a part of an object is damaged");
        }
        o->messages += 1;
        if (!check_message(w, o, (int)number(at, 2), at + MESSAGE_SIZE, content)) {
            return false;
        }
        at += MESSAGE_SIZE + content;
        size -= MESSAGE_SIZE + content;
    }
    return true;
}

// --- groups (III.A, III.B, III.C, III.D) ---

static bool check_object(file_walk *w, uint64_t address, int depth, object_facts *o);

// Returns true if a terminated name begins at this offset of the heap.
static bool has_name(const name_heap *names, uint64_t offset) {
    return offset < names->size &&
           strnlen((const char *)names->text + offset, names->size - offset) < names->size - offset;
}

// Checks a local heap: names, and a linked list of gaps (next, size), whose last gap has next = 1.
static bool check_heap(file_walk *w, uint64_t address, name_heap *names) {
    const unsigned char *at = claim(w, address, HEAP_SIZE);
    if (at == NULL || memcmp(at, "HEAP\0\0\0\0", 8) != 0) {
        return object_to(w, "a list of names is damaged");
    }
    names->size = number(at + 8, 8);
    names->text = claim(w, number(at + 24, 8), names->size);
    uint64_t gap = number(at + 16, 8), gaps = 0;
    for (; gap != 1; gap = number(names->text + gap, 8)) {
        if (names->text == NULL || names->size < 16 || gap > names->size - 16 || gap % 8 != 0 ||
            number(names->text + gap + 8, 8) < 16 ||
            number(names->text + gap + 8, 8) > names->size - gap || ++gaps > names->size / 16) {
            return object_to(w, "a list of names is damaged");
        }
    }
    return names->text != NULL;
}

// Checks a symbol and its object. A symbol may cache where a group has its members; the cache must
// agree with the object.
static bool check_entry(file_walk *w, const unsigned char *at, int depth) {
    object_facts o = {0};
    const uint64_t cached = number(at + 16, 4);
    if (cached > 1) {
        return object_to(w, "it has links");
    }
    if (!check_object(w, number(at + 8, 8), depth, &o)) {
        return false;
    }
    return cached == 0 ||
           (o.group && number(at + 24, 8) == o.tree && number(at + 32, 8) == o.names) ||
           object_to(w, "a group is damaged");
}

static bool check_symbols(file_walk *w, uint64_t address, const name_heap *names, int depth) {
    const unsigned char *at = claim(w, address, NODE_SIZE);
    if (at == NULL || memcmp(at, "SNOD\1", 5) != 0 || number(at + 6, 2) > 2 * LEAF_K) {
        return object_to(w, "a group is damaged");
    }
    const int count = (int)number(at + 6, 2);
    for (int i = 0; i < count; ++i) {
        const unsigned char *entry = at + 8 + i * ENTRY_SIZE;
        if (!has_name(names, number(entry, 8))) {
            return object_to(w, "a name is damaged");
        }
        if (!check_entry(w, entry, depth)) {
            return false;
        }
    }
    return true;
}

// Checks a B-tree node and all below it. `level` is the expected height of the node; -1: any.
static bool check_tree(file_walk *w, uint64_t address, const name_heap *names, int level,
                       int depth) {
    const unsigned char *at = claim(w, address, TREE_SIZE);
    if (at == NULL || memcmp(at, "TREE\0", 5) != 0 || at[5] > MAX_LEVEL ||
        (level >= 0 && at[5] != level) || number(at + 6, 2) > 2 * INTERNAL_K) {
        return object_to(w, "a group is damaged");
    }
    const int count = (int)number(at + 6, 2);
    for (int i = 0; i < 2; ++i) {
        const uint64_t sibling = number(at + 8 + 8 * i, 8);
        if (sibling != UNDEFINED && (level < 0 || !lies_within(w, sibling, TREE_SIZE))) {
            return object_to(w, "a group is damaged");
        }
    }
    for (int i = 0; i < count; ++i) {
        const unsigned char *key = at + 24 + 16 * i;
        const uint64_t child = number(key + 8, 8);
        if (!has_name(names, number(key, 8)) || !has_name(names, number(key + 16, 8))) {
            return object_to(w, "a name is damaged");
        }
        if (!(at[5] == 0 ? check_symbols(w, child, names, depth)
                         : check_tree(w, child, names, at[5] - 1, depth))) {
            return false;
        }
    }
    return true;
}

// --- objects (IV.A.1.a) and the file (II.A) ---

static bool check_object(file_walk *w, uint64_t address, int depth, object_facts *o) {
    const unsigned char *at = claim(w, address, HEADER_SIZE);
    if (at == NULL || depth > MAX_DEPTH || at[0] != 1) {
        return object_to(w, "an object has another version");
    }
    if (number(at + 8, 4) > 0 && !check_block(w, o, address + HEADER_SIZE, number(at + 8, 4))) {
        return false;
    }
    if (o->messages != (int)number(at + 2, 2)) {
        return object_to(w, "an object is damaged");
    }
    const bool dataset = o->space && o->type && o->layout;
    if (o->group == (o->space || o->type || o->layout) || (!o->group && !dataset)) {
        return object_to(w, "an object is neither a group nor a dataset");
    }
    if (dataset) {
        return o->stored == o->values * o->value_size || object_to(w, "a dataset is damaged");
    }
    name_heap names;
    return check_heap(w, o->names, &names) && check_tree(w, o->tree, &names, -1, depth + 1);
}

const char *pm_hdf5_check(const void *data, size_t size) {
    static const unsigned char head[] = {0x89, 'H', 'D',    'F', '\r',       '\n', 0x1a,
                                         '\n', 0,   0,      0,   0,          0,    8,
                                         8,    0,   LEAF_K, 0,   INTERNAL_K, 0};
    file_walk w = {.data = data, .size = size};
    const unsigned char *at = claim(&w, 0, SUPERBLOCK_SIZE);
    if (at == NULL || memcmp(at, head, sizeof head) != 0 || number(at + 20, 4) != 0 ||
        number(at + 24, 8) != 0 || number(at + 32, 8) != UNDEFINED ||
        number(at + 48, 8) != UNDEFINED) {
        object_to(&w, "it does not begin as files of portmet do");
    } else if (number(at + 40, 8) > size) {
        object_to(&w, "it is truncated");
    } else {
        w.size = number(at + 40, 8);
        check_entry(&w, at + 56, 0);
    }
    // No two structures may share bytes.
    if (w.objection == NULL && w.count > 0) {
        qsort(w.extent, (size_t)w.count, sizeof *w.extent, compare_extents);
    }
    for (int i = 1; w.objection == NULL && i < w.count; ++i) {
        if (w.extent[i].from < w.extent[i - 1].to) {
            object_to(&w, "parts of it overlap");
        }
    }
    free(w.extent);
    return w.objection;
}
