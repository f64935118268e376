// Reads YAML with libyaml, whose only caller is yaml.c. Every reader
// checks what it returns and fails with PM_ECONFIG and one line that names file, line, column and
// key, such as: double_pendulum.yaml:12:9: dt: expected a number > 0, found "abc".
#ifndef PM_STORE_YAML_H
#define PM_STORE_YAML_H

#include <stdbool.h>
#include <stdio.h>

#include "base/arena.h"
#include "base/status.h"

typedef struct pm_yaml_document pm_yaml_document;

// A value inside a document. It is cheap to copy and valid while the document is open.
typedef struct pm_yaml {
    const pm_yaml_document *document;
    int node; // 0: the value is absent
} pm_yaml;

// pm_yaml_open reads a file, and pm_yaml_parse reads `text`, which error messages call `name`.
// `root` receives the top value. PM_EFILE: the file cannot be read; PM_ECONFIG; PM_ENOMEM. These
// are errors, since no configuration needs them: an empty file, more than a megabyte, a second
// document, more than 200 open brackets, a duplicate key, an alias, a tag, text of several lines.
// The caller closes the document.
pm_status pm_yaml_open(pm_yaml_document **document, const char *path, pm_yaml *root);
pm_status pm_yaml_parse(pm_yaml_document **document, const char *text, const char *name,
                        pm_yaml *root);
void pm_yaml_close(pm_yaml_document *document); // NULL is allowed

bool pm_yaml_exists(pm_yaml value);
bool pm_yaml_is_map(pm_yaml value);
bool pm_yaml_is_list(pm_yaml value);
bool pm_yaml_is_text(pm_yaml value, const char *text); // a scalar that equals `text`

// Always returns PM_ECONFIG. Sets the error to "file:line:column: key: " and the message, where
// `key` is the key whose value is `at`.
pm_status pm_yaml_fail(pm_yaml at, const char *format, ...) __attribute__((format(printf, 2, 3)));
// Returns "file:line:column" in the arena, for errors that are found after the document is closed.
// NULL: out of memory.
const char *pm_yaml_where(pm_yaml at, pm_arena *arena);

// Returns the mapping's value under `key`. The result is absent if the key is missing or `map` is
// not a mapping.
pm_yaml pm_yaml_get(pm_yaml map, const char *key);
// Does the same, but fails if the key is missing or `map` is not a mapping.
pm_status pm_yaml_require(pm_yaml map, const char *key, pm_yaml *value);
// Fails at the first key of `map` that is not in the NULL-terminated list and names the allowed
// keys; fails too if `map` is not a mapping.
pm_status pm_yaml_allow(pm_yaml map, const char *const *keys);
// Fails if `map` is not a mapping or has no entries.
pm_status pm_yaml_require_entries(pm_yaml map);

// Returns the number of entries of a list or mapping; 0 for other values.
int pm_yaml_count(pm_yaml value);
// Returns entry i >= 0 of a list. The result is absent if it has no such entry or is no list.
pm_yaml pm_yaml_item(pm_yaml list, int i);
// Does the same for a value that may stand for a list of one: returns the value itself if it is no
// list.
pm_yaml pm_yaml_item_or_self(pm_yaml value, int i);
// Gives key (a scalar) and value of entry i of a mapping, in the order of the file.
void pm_yaml_entry(pm_yaml map, int i, pm_yaml *key, pm_yaml *value);

// Read one scalar. A number must be decimal, finite, not quoted, and within [low, high]; `low` =
// DBL_MIN means > 0, and an infinite bound means none. Text must not be empty and is copied into
// the arena.
pm_status pm_yaml_double(pm_yaml value, double low, double high, double *result);
pm_status pm_yaml_int(pm_yaml value, int low, int high, int *result);
pm_status pm_yaml_bool(pm_yaml value, bool *result); // true or false
pm_status pm_yaml_text(pm_yaml value, pm_arena *arena, const char **result);
// Gives the position of the scalar among the NULL-terminated `names`; the error lists them.
pm_status pm_yaml_choice(pm_yaml value, const char *const *names, int *result);
// Read a list of scalars into the arena: result [count]. A single scalar counts as a list of one.
pm_status pm_yaml_doubles(pm_yaml list, pm_arena *arena, int *count, double **result);
pm_status pm_yaml_ints(pm_yaml list, int low, int high, pm_arena *arena, int *count, int **result);
pm_status pm_yaml_texts(pm_yaml list, pm_arena *arena, int *count, const char ***result);
// Reads a list of exactly `count` numbers into result [count].
pm_status pm_yaml_vector(pm_yaml list, int count, pm_arena *arena, double *result);

// --- all keys of a mapping ---

// A key that a mapping may have, and where its value goes. Tables of keys are made with the macros
// below and end with {0}:
//     int steps = 0;
//     double pace = 1;
//     const pm_yaml_key keys[] = {{PM_YAML_INT("steps", &steps, 1, 100), .required = true},
//                                 {PM_YAML_DOUBLE("pace", &pace, DBL_MIN, INFINITY)},
//                                 {0}};
//     PM_TRY(pm_yaml_read(map, arena, keys));
typedef struct pm_yaml_key {
    const char *name;
    enum {
        PM_YAML_IS_VALUE,
        PM_YAML_IS_DOUBLE,
        PM_YAML_IS_INT,
        PM_YAML_IS_BOOL,
        PM_YAML_IS_TEXT,
        PM_YAML_IS_TEXTS,
        PM_YAML_IS_VECTOR,
        PM_YAML_IS_CHOICE
    } type;
    union {
        pm_yaml *value;
        double *number;
        int *whole;
        bool *truth;
        const char **text;
        const char *const **texts; // [*count]
    } to;
    double low, high;         // of a number
    const char *const *names; // of a choice
    int *count;               // of texts
    int length;               // of a vector
    bool required;
} pm_yaml_key;

#define PM_YAML_VALUE(key, to_) .name = key, .type = PM_YAML_IS_VALUE, .to.value = to_
#define PM_YAML_DOUBLE(key, to_, low_, high_) \
    .name = key, .type = PM_YAML_IS_DOUBLE, .to.number = to_, .low = low_, .high = high_
#define PM_YAML_INT(key, to_, low_, high_) \
    .name = key, .type = PM_YAML_IS_INT, .to.whole = to_, .low = low_, .high = high_
#define PM_YAML_BOOL(key, to_) .name = key, .type = PM_YAML_IS_BOOL, .to.truth = to_
#define PM_YAML_TEXT(key, to_) .name = key, .type = PM_YAML_IS_TEXT, .to.text = to_
#define PM_YAML_TEXTS(key, count_, to_) \
    .name = key, .type = PM_YAML_IS_TEXTS, .to.texts = to_, .count = count_
#define PM_YAML_VECTOR(key, to_, length_) \
    .name = key, .type = PM_YAML_IS_VECTOR, .to.number = to_, .length = length_
#define PM_YAML_CHOICE(key, to_, names_) \
    .name = key, .type = PM_YAML_IS_CHOICE, .to.whole = to_, .names = names_

// Reads all keys of a mapping, in the order of the table. What belongs to a missing key stays as it
// was, but a missing value becomes absent, and the caller reads a value that goes to NULL; an
// absent mapping has no keys. PM_ECONFIG: the value is no mapping, has a key that is not in the
// table, lacks one that is required, or has a value that is not allowed. PM_ENOMEM.
pm_status pm_yaml_read(pm_yaml map, pm_arena *arena, const pm_yaml_key *keys);

// --- changes ---

// A change of the text from which a document was read.
typedef struct pm_yaml_change {
    pm_yaml at;       // a list or mapping; or, with `replaces`, any value
    bool replaces;    // the text takes the place of the value; else it becomes the first entry
    const char *text; // one value or entry in flow style, such as "hidden: [6]" for a mapping
} pm_yaml_change;

// Writes the text of a document with `count` changes, which do not contain each other, to `file`.
// Sorts `change`. Comments and all other values stay as they are.
void pm_yaml_write_changed(const pm_yaml_document *document, int count, pm_yaml_change *change,
                           FILE *file);

#endif
