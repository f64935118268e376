// A walk through all objects of a file, from the superblock on. Nothing is believed before it has
// been checked; the first objection ends the walk.
#include "store/hdf5_check.h"

#include <endian.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#define UNDEFINED UINT64_MAX // an address that is not there
#define LEAF_K 4             // the library's defaults: half the symbols of a symbol table node
#define INTERNAL_K 16        // and half the children of a B-tree node
#define MAX_DEPTH 4          // of groups
#define MAX_LEVEL 8          // of B-trees
#define MAX_RANK 4
#define MAX_VALUES (UINT64_C(1) << 28) // as of any dataset that is read
#define MAX_EXTENTS 65536
#define MAX_BLOCKS 256 // of messages, of one object

#define SUPERBLOCK_SIZE 96
#define ENTRY_SIZE 40 // of a symbol table
#define TREE_SIZE (24 + 8 * (4 * INTERNAL_K + 1))
#define NODE_SIZE (8 + 2 * LEAF_K * ENTRY_SIZE)
#define HEAP_SIZE 32
#define HEADER_SIZE 16 // of an object
#define MESSAGE_SIZE 8 // before its content

// Bytes [from, to) that one structure takes.
typedef struct extent {
    uint64_t from, to;
} extent;

typedef struct walk {
    const unsigned char *data;
    uint64_t size, claimed;
    const char *objection; // NULL: none so far
    int count, capacity;
    extent *extent; // [count]
} walk;

// The names of a group.
typedef struct heap {
    const unsigned char *text;
    uint64_t size;
} heap;

// What the messages of an object have said.
typedef struct object {
    bool space, type, layout, group;
    uint64_t values, value_size; // of the dataspace; of the datatype
    uint64_t stored;             // bytes of the layout
    uint64_t tree, names;        // of the group
    int messages, blocks;
} object;

static bool object_to(walk *w, const char *objection) {
    if (w->objection == NULL) {
        w->objection = objection;
    }
    return false;
}

// --- bytes ---

static uint64_t number(const unsigned char *at, int size) {
    uint64_t value = 0;
    for (int i = size - 1; i >= 0; --i) {
        value = value << 8 | at[i];
    }
    return value;
}

static bool lies_within(const walk *w, uint64_t address, uint64_t size) {
    return address <= w->size && size <= w->size - address;
}

// Takes the bytes of a structure, which nothing else may share; NULL if they are not there. Since
// all that is claimed fits the file, a walk ends, even in circles.
static const unsigned char *claim(walk *w, uint64_t address, uint64_t size) {
    if (!lies_within(w, address, size)) {
        object_to(w, "something lies beyond its end");
        return NULL;
    }
    w->claimed += size;
    if (w->claimed > w->size || w->count == MAX_EXTENTS) {
        object_to(w, "parts of it overlap, or there are too many");
        return NULL;
    }
    if (w->count == w->capacity) {
        const int capacity = 2 * w->capacity + 64;
        extent *larger = realloc(w->extent, (size_t)capacity * sizeof *larger);
        if (larger == NULL) {
            object_to(w, "out of memory");
            return NULL;
        }
        w->extent = larger;
        w->capacity = capacity;
    }
    w->extent[w->count++] = (extent){address, address + size};
    return w->data + address;
}

static int compare_extents(const void *a, const void *b) {
    const extent *x = a, *y = b;
    return x->from < y->from ? -1 : x->from > y->from;
}

static void check_apart(walk *w) {
    if (w->count > 0) {
        qsort(w->extent, (size_t)w->count, sizeof *w->extent, compare_extents);
    }
    for (int i = 1; i < w->count; ++i) {
        if (w->extent[i].from < w->extent[i - 1].to) {
            object_to(w, "parts of it overlap");
        }
    }
}

// --- datatypes (IV.A.2.d), dataspaces (IV.A.2.b) ---

// Bytes of a value; 0 if it is none of the types that are written here.
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

// Values of a dataspace; false if it is none.
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

// --- messages of an object (IV.A.2) ---

static uint64_t padded(uint64_t size) {
    return (size + 7) / 8 * 8;
}

static bool check_attribute(walk *w, const unsigned char *at, uint64_t size) {
    if (size < 8 || at[0] != 1) {
        return object_to(w, "an attribute is of another version");
    }
    const uint64_t name_size = number(at + 2, 2), type = number(at + 4, 2),
                   space = number(at + 6, 2);
    const uint64_t head = 8 + padded(name_size) + padded(type) + padded(space);
    if (head > size) {
        return object_to(w, "an attribute is cut");
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
    return values * bytes <= size - head || object_to(w, "an attribute is cut");
}

// The value of what was never written: none, or an empty one.
static bool check_fill(walk *w, const unsigned char *at, uint64_t size) {
    const bool good = size >= 4 && at[0] == 2 && at[1] <= 3 && at[2] <= 2 &&
                      (at[3] == 0 || (at[3] == 1 && size >= 8 && number(at + 4, 4) == 0));
    return good || object_to(w, "a fill value is of another kind");
}

static bool check_layout(walk *w, object *o, const unsigned char *at, uint64_t size) {
    if (size < 18 || at[0] != 3 || at[1] != 1) {
        return object_to(w, "a dataset is not stored in one piece");
    }
    o->stored = number(at + 10, 8);
    return claim(w, number(at + 2, 8), o->stored) != NULL;
}

static bool is_new(walk *w, bool *seen) {
    const bool new = !*seen;
    *seen = true;
    return new || object_to(w, "an object says something twice");
}

static bool check_block(walk *w, object *o, uint64_t address, uint64_t size);

static bool check_message(walk *w, object *o, int type, const unsigned char *at, uint64_t size) {
    switch (type) {
    case 0x00: // nothing
        return true;
    case 0x01:
        return is_new(w, &o->space) &&
               (space_values(at, size, &o->values) || object_to(w, "a dataspace is damaged"));
    case 0x03:
        o->value_size = type_size(at, size);
        return is_new(w, &o->type) &&
               (o->value_size > 0 || object_to(w, "a dataset is not of plain numbers or text"));
    case 0x05:
        return check_fill(w, at, size);
    case 0x08:
        return is_new(w, &o->layout) && check_layout(w, o, at, size);
    case 0x0c:
        return check_attribute(w, at, size);
    case 0x10:
        return size >= 16 ? check_block(w, o, number(at, 8), number(at + 8, 8))
                          : object_to(w, "an object is cut");
    case 0x11:
        if (size < 16) {
            return object_to(w, "a group is cut");
        }
        o->tree = number(at, 8);
        o->names = number(at + 8, 8);
        return is_new(w, &o->group);
    case 0x12: // time of change
        return (size >= 8 && at[0] == 1) || object_to(w, "a time is of another version");
    default:
        return object_to(w, "it uses other features of HDF5 than files written here");
    }
}

// A block of messages, which fill it.
static bool check_messages(walk *w, object *o, const unsigned char *at, uint64_t size) {
    while (size > 0) {
        if (size < MESSAGE_SIZE) {
            return object_to(w, "an object is cut");
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

static bool check_block(walk *w, object *o, uint64_t address, uint64_t size) {
    if (++o->blocks > MAX_BLOCKS) {
        return object_to(w, "a part of an object is damaged");
    }
    const unsigned char *at = claim(w, address, size);
    return at != NULL && check_messages(w, o, at, size);
}

// --- groups (III.A, III.B, III.C, III.D) ---

static bool check_object(walk *w, uint64_t address, int depth, object *o);

static bool has_name(const heap *names, uint64_t offset) {
    return offset < names->size &&
           strnlen((const char *)names->text + offset, names->size - offset) < names->size - offset;
}

// Names, and a list of gaps between them: (next, size), the last with next 1.
static bool check_heap(walk *w, uint64_t address, heap *names) {
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

// A symbol: an object, and where a group has its members, which must be what the object says.
static bool check_entry(walk *w, const unsigned char *at, int depth) {
    object o = {0};
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

static bool check_symbols(walk *w, uint64_t address, const heap *names, int depth) {
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

// `level` is that of the node; -1: any.
static bool check_tree(walk *w, uint64_t address, const heap *names, int level, int depth) {
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

static bool check_object(walk *w, uint64_t address, int depth, object *o) {
    const unsigned char *at = claim(w, address, HEADER_SIZE);
    if (at == NULL || depth > MAX_DEPTH || at[0] != 1) {
        return object_to(w, "an object is of another version");
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
    heap names;
    return check_heap(w, o->names, &names) && check_tree(w, o->tree, &names, -1, depth + 1);
}

static void check_file(walk *w) {
    static const unsigned char head[] = {0x89, 'H', 'D',    'F', '\r',       '\n', 0x1a,
                                         '\n', 0,   0,      0,   0,          0,    8,
                                         8,    0,   LEAF_K, 0,   INTERNAL_K, 0};
    const unsigned char *at = claim(w, 0, SUPERBLOCK_SIZE);
    if (at == NULL || memcmp(at, head, sizeof head) != 0) {
        object_to(w, "it begins like none that was written here");
        return;
    }
    const uint64_t end = number(at + 40, 8);
    if (number(at + 20, 4) != 0 || number(at + 24, 8) != 0 || number(at + 32, 8) != UNDEFINED ||
        number(at + 48, 8) != UNDEFINED) {
        object_to(w, "it begins like none that was written here");
    } else if (end > w->size) {
        object_to(w, "it is cut");
    } else {
        w->size = end;
        check_entry(w, at + 56, 0);
    }
}

const char *pm_hdf5_check(const void *data, size_t size) {
    walk w = {.data = data, .size = size};
    check_file(&w);
    if (w.objection == NULL) {
        check_apart(&w);
    }
    free(w.extent);
    return w.objection;
}
