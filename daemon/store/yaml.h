// Reading YAML with errors that carry file, line and column: libyaml's document API and a walk.
// The only door to libyaml. Every reader checks what it returns and fails with PM_ECONFIG and one
// line such as "double_pendulum.yaml:12:9: dt: expected a number > 0, found "abc"".
#ifndef PM_STORE_YAML_H
#define PM_STORE_YAML_H

#include <stdbool.h>

#include "base/arena.h"
#include "base/status.h"

typedef struct pm_yaml_document pm_yaml_document;

// A value inside a document, cheap to copy; valid while the document is open. `node` 0: absent.
typedef struct pm_yaml {
    const pm_yaml_document *document;
    int node;
} pm_yaml;

// Opens a file (PM_EFILE if it cannot be read) or parses text; `name` stands for it in errors.
// `root` receives the top value. What a configuration has no use for is an error: an empty file,
// more than a megabyte or one document, 200 open brackets, a duplicate key, aliases, tags, text of
// several lines.
pm_status pm_yaml_open(pm_yaml_document **document, const char *path, pm_yaml *root);
pm_status pm_yaml_parse(pm_yaml_document **document, const char *text, const char *name,
                        pm_yaml *root);
void pm_yaml_close(pm_yaml_document *document); // NULL is allowed

bool pm_yaml_exists(pm_yaml value);
bool pm_yaml_is_map(pm_yaml value);
bool pm_yaml_is_list(pm_yaml value);
bool pm_yaml_is_text(pm_yaml value, const char *text); // a scalar spelled exactly so

// pm_fail(PM_ECONFIG) with "file:line:column: key: " in front, where `key` is the one that `at`
// stands under.
pm_status pm_yaml_fail(pm_yaml at, const char *format, ...) __attribute__((format(printf, 2, 3)));
// "file:line:column" in the arena, for errors found after the document is closed. NULL: out of
// memory.
const char *pm_yaml_where(pm_yaml at, pm_arena *arena);

// The mapping's value under `key`; absent (node 0) if there is none or `map` is not a mapping.
pm_yaml pm_yaml_get(pm_yaml map, const char *key);
// The same, an error if absent or if `map` is not a mapping.
pm_status pm_yaml_require(pm_yaml map, const char *key, pm_yaml *value);
// An error at the first key of `map` that is not in the NULL-terminated list; it names the allowed.
// An error too if `map` is not a mapping.
pm_status pm_yaml_allow(pm_yaml map, const char *const *keys);
// An error if `map` is not a mapping, or an empty one.
pm_status pm_yaml_require_entries(pm_yaml map);

// Number of entries of a list or mapping; 0 for others. Entry i of a list; key (a scalar) and value
// of entry i of a mapping, in the order written.
int pm_yaml_count(pm_yaml value);
pm_yaml pm_yaml_item(pm_yaml list, int i);
void pm_yaml_entry(pm_yaml map, int i, pm_yaml *key, pm_yaml *value);

// Scalars. Numbers are decimal, finite, not quoted, and lie within [low, high]; low = DBL_MIN
// stands for "> 0", infinite bounds for none. Text is not empty, and is copied into the arena.
pm_status pm_yaml_double(pm_yaml value, double low, double high, double *result);
pm_status pm_yaml_int(pm_yaml value, int low, int high, int *result);
pm_status pm_yaml_bool(pm_yaml value, bool *result); // true or false
pm_status pm_yaml_text(pm_yaml value, pm_arena *arena, const char **result);
// One of the NULL-terminated `names`; its position. The error lists them.
pm_status pm_yaml_choice(pm_yaml value, const char *const *names, int *result);
// Lists of scalars, in the arena; a single scalar counts as a list of one.
pm_status pm_yaml_doubles(pm_yaml list, pm_arena *arena, int *count, double **result);
pm_status pm_yaml_ints(pm_yaml list, int low, int high, pm_arena *arena, int *count, int **result);
pm_status pm_yaml_texts(pm_yaml list, pm_arena *arena, int *count, const char ***result);

#endif
