// Reads YAML. libyaml composes a document; adopt() then checks that it is a tree of mappings, lists
// and single lines of text, and notes the place of every value in it, so that the readers can walk
// it without further checks and an error can name the key.
#include "store/yaml.h"

#include <errno.h>
#include <float.h>
#include <limits.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <yaml.h>

#include "base/files.h"

#define MAX_BYTES \
    ((size_t)1 << 20)    // far above any configuration; limits the work that hostile text can cause
#define MAX_BRACKETS 200 // open at once; the time of libyaml grows with the square of the depth
#define MAX_ENTRIES 10000 // of one mapping; its keys are compared pairwise

struct pm_yaml_document {
    pm_arena arena;
    const char *name; // of the file, for errors
    const char *text; // from which it was read
    bool composed;    // `yaml` must be deleted
    yaml_document_t yaml;
    int *parent; // [node] the list or mapping that contains the node
    int *key;    // [node] the key whose value the node is; 0: the node has no key
};

// Returns libyaml's node of a value; NULL for an absent value.
static const yaml_node_t *node_of(pm_yaml value) {
    return value.node == 0 ? NULL : &value.document->yaml.nodes.start[value.node - 1];
}

// Returns the text of a scalar; NULL for a list, a mapping or an absent value.
static const char *scalar_of(pm_yaml value) {
    const yaml_node_t *node = node_of(value);
    return node != NULL && node->type == YAML_SCALAR_NODE ? (const char *)node->data.scalar.value
                                                          : NULL;
}

// Returns the value that stands at `node` of the document to which `value` belongs.
static pm_yaml sibling_of(pm_yaml value, int node) {
    return (pm_yaml){value.document, node};
}

// --- errors ---

pm_status pm_yaml_fail(pm_yaml at, const char *format, ...) {
    char text[768];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    const yaml_node_t *node = node_of(at);
    // The key under which the value stands, or the list that the value is an item of.
    pm_yaml labelled = at;
    while (labelled.node != 0 && at.document->key[labelled.node] == 0) {
        labelled.node = at.document->parent[labelled.node];
    }
    const char *label =
        labelled.node == 0 ? "" : scalar_of(sibling_of(at, at.document->key[labelled.node]));
    return pm_fail(PM_ECONFIG, "%s:%zu:%zu: %.64s%s%s", at.document->name,
                   node == NULL ? 1 : node->start_mark.line + 1,
                   node == NULL ? 1 : node->start_mark.column + 1, label, *label ? ": " : "", text);
}

const char *pm_yaml_where(pm_yaml at, pm_arena *arena) {
    const yaml_node_t *node = node_of(at);
    return pm_arena_printf(arena, "%s:%zu:%zu", at.document->name,
                           node == NULL ? 1 : node->start_mark.line + 1,
                           node == NULL ? 1 : node->start_mark.column + 1);
}

static pm_status fail_memory(void) {
    return pm_fail(PM_ENOMEM, "out of memory while reading YAML");
}

// Fails with "expected <what>, found <the value>".
static pm_status fail_expected(pm_yaml value, const char *what) {
    const char *text = scalar_of(value);
    if (text == NULL) {
        return pm_yaml_fail(value, "expected %s, found %s", what,
                            pm_yaml_is_map(value)    ? "a mapping"
                            : pm_yaml_is_list(value) ? "a list"
                                                     : "nothing");
    }
    if (*text == '\0') {
        return pm_yaml_fail(value, "expected %s, found nothing", what);
    }
    const bool quoted = node_of(value)->data.scalar.style != YAML_PLAIN_SCALAR_STYLE;
    return pm_yaml_fail(value, "expected %s, found %s\"%.40s%s\"", what, quoted ? "the text " : "",
                        text, strlen(text) > 40 ? "..." : "");
}

// --- names in messages ---

// Joins the NULL-terminated names to "a, b, c" in `buffer`, cut to `size`. Returns `buffer`.
static const char *join(const char *const *names, char *buffer, size_t size) {
    size_t used = 0;
    buffer[0] = '\0';
    for (int i = 0; names[i] != NULL && used < size; ++i) {
        used += (size_t)snprintf(buffer + used, size - used, "%s%s", i == 0 ? "" : ", ", names[i]);
    }
    return buffer;
}

// Returns the position of a scalar among the NULL-terminated `names`; -1 if it is none of them.
static int position(const char *const *names, pm_yaml value) {
    for (int i = 0; names[i] != NULL; ++i) {
        if (pm_yaml_is_text(value, names[i])) {
            return i;
        }
    }
    return -1;
}

// --- walking ---

bool pm_yaml_exists(pm_yaml value) {
    return value.node != 0;
}

bool pm_yaml_is_map(pm_yaml value) {
    const yaml_node_t *node = node_of(value);
    return node != NULL && node->type == YAML_MAPPING_NODE;
}

bool pm_yaml_is_list(pm_yaml value) {
    const yaml_node_t *node = node_of(value);
    return node != NULL && node->type == YAML_SEQUENCE_NODE;
}

bool pm_yaml_is_text(pm_yaml value, const char *text) {
    const char *own = scalar_of(value);
    return own != NULL && strcmp(own, text) == 0;
}

int pm_yaml_count(pm_yaml value) {
    const yaml_node_t *node = node_of(value);
    if (pm_yaml_is_list(value)) {
        return (int)(node->data.sequence.items.top - node->data.sequence.items.start);
    }
    if (pm_yaml_is_map(value)) {
        return (int)(node->data.mapping.pairs.top - node->data.mapping.pairs.start);
    }
    return 0;
}

pm_yaml pm_yaml_item(pm_yaml list, int i) {
    if (!pm_yaml_is_list(list) || i >= pm_yaml_count(list)) {
        return sibling_of(list, 0);
    }
    return sibling_of(list, node_of(list)->data.sequence.items.start[i]);
}

pm_yaml pm_yaml_item_or_self(pm_yaml value, int i) {
    return pm_yaml_is_list(value) ? pm_yaml_item(value, i) : value;
}

void pm_yaml_entry(pm_yaml map, int i, pm_yaml *key, pm_yaml *value) {
    const yaml_node_pair_t *pair = &node_of(map)->data.mapping.pairs.start[i];
    *key = sibling_of(map, pair->key);
    *value = sibling_of(map, pair->value);
}

pm_yaml pm_yaml_get(pm_yaml map, const char *key) {
    for (int i = 0; pm_yaml_is_map(map) && i < pm_yaml_count(map); ++i) {
        pm_yaml own, value;
        pm_yaml_entry(map, i, &own, &value);
        if (pm_yaml_is_text(own, key)) {
            return value;
        }
    }
    return sibling_of(map, 0);
}

pm_status pm_yaml_require(pm_yaml map, const char *key, pm_yaml *value) {
    if (!pm_yaml_is_map(map)) {
        return fail_expected(map, "a mapping");
    }
    const pm_yaml found = pm_yaml_get(map, key);
    if (!pm_yaml_exists(found)) {
        return pm_yaml_fail(map, "missing key \"%s\"", key);
    }
    *value = found;
    return PM_OK;
}

// Keys that have been renamed. The error for an old key names the new one.
static const struct {
    const char *before, *now;
} renamed[] = {
    {"loads", "boundary_inputs"}, {"images", "derived"},     {"rest", "zero_at_origin"},
    {"section", "symmetry"},      {"swing", "inertia_time"}, {"region", "training_range"},
};

pm_status pm_yaml_allow(pm_yaml map, const char *const *keys) {
    if (!pm_yaml_is_map(map)) {
        return fail_expected(map, "a mapping");
    }
    for (int i = 0; i < pm_yaml_count(map); ++i) {
        pm_yaml key, value;
        pm_yaml_entry(map, i, &key, &value);
        if (position(keys, key) >= 0) {
            continue;
        }
        for (size_t j = 0; j < sizeof renamed / sizeof renamed[0]; ++j) {
            for (int k = 0; pm_yaml_is_text(key, renamed[j].before) && keys[k] != NULL; ++k) {
                if (strcmp(keys[k], renamed[j].now) == 0) {
                    return pm_yaml_fail(key, "the key \"%s\" is called \"%s\" now",
                                        renamed[j].before, renamed[j].now);
                }
            }
        }
        char list[512];
        return pm_yaml_fail(key, "unknown key \"%.64s\"; allowed: %s", scalar_of(key),
                            join(keys, list, sizeof list));
    }
    return PM_OK;
}

pm_status pm_yaml_require_entries(pm_yaml map) {
    return pm_yaml_is_map(map) && pm_yaml_count(map) > 0
               ? PM_OK
               : fail_expected(map, "a mapping with at least one entry");
}

// --- scalars ---

// Returns the text of an unquoted scalar that consists of the given characters, which exclude
// hexadecimal numbers, infinities and NaN; otherwise NULL.
static const char *number_text(pm_yaml value, const char *characters) {
    const char *text = scalar_of(value);
    const bool plain = text != NULL && node_of(value)->data.scalar.style == YAML_PLAIN_SCALAR_STYLE;
    return plain && *text != '\0' && text[strspn(text, characters)] == '\0' ? text : NULL;
}

static pm_status fail_range(pm_yaml value, const char *noun, double low, double high) {
    char what[96];
    const bool positive = low == DBL_MIN;
    if (isinf(low) && isinf(high)) {
        snprintf(what, sizeof what, "%s", noun);
    } else if (isinf(low)) {
        snprintf(what, sizeof what, "%s <= %.10g", noun, high);
    } else if (isinf(high)) {
        snprintf(what, sizeof what, "%s %s %.10g", noun, positive ? ">" : ">=", positive ? 0 : low);
    } else {
        snprintf(what, sizeof what, "%s %s %.10g and <= %.10g", noun,
                 positive ? ">" : ">=", positive ? 0 : low, high);
    }
    return fail_expected(value, what);
}

pm_status pm_yaml_double(pm_yaml value, double low, double high, double *result) {
    const char *text = number_text(value, "+-0123456789.eE");
    char *end = NULL;
    const double number = text == NULL ? NAN : strtod(text, &end);
    if (text == NULL || *end != '\0' || !isfinite(number) || number < low || number > high) {
        return fail_range(value, "a number", low, high);
    }
    *result = number;
    return PM_OK;
}

pm_status pm_yaml_int(pm_yaml value, int low, int high, int *result) {
    const char *text = number_text(value, "+-0123456789");
    char *end = NULL;
    const long number =
        text == NULL ? 0 : strtol(text, &end, 10); // saturates, and the range then refuses it
    if (text == NULL || *end != '\0' || end == text || number < low || number > high) {
        return fail_range(value, "a whole number", low == INT_MIN ? -INFINITY : (double)low,
                          high == INT_MAX ? INFINITY : (double)high);
    }
    *result = (int)number;
    return PM_OK;
}

pm_status pm_yaml_bool(pm_yaml value, bool *result) {
    static const char *const names[] = {"false", "true", NULL};
    int choice;
    PM_TRY(pm_yaml_choice(value, names, &choice));
    *result = choice == 1;
    return PM_OK;
}

pm_status pm_yaml_text(pm_yaml value, pm_arena *arena, const char **result) {
    const char *text = scalar_of(value);
    if (text == NULL || *text == '\0') {
        return fail_expected(value, "text");
    }
    *result = pm_arena_strdup(arena, text);
    return pm_arena_status(arena, "text of a YAML document");
}

pm_status pm_yaml_choice(pm_yaml value, const char *const *names, int *result) {
    const int choice = position(names, value);
    if (choice < 0) {
        char list[512], what[600];
        snprintf(what, sizeof what, "one of %s", join(names, list, sizeof list));
        return fail_expected(value, what);
    }
    *result = choice;
    return PM_OK;
}

// --- lists of scalars ---

// Gives the number of entries, and memory for them of `size` bytes each.
static pm_status open_list(pm_yaml list, const char *what, pm_arena *arena, size_t size, int *count,
                           void **memory) {
    const bool is_list = pm_yaml_is_list(list);
    if (!is_list && scalar_of(list) == NULL) {
        return fail_expected(list, what);
    }
    *count = is_list ? pm_yaml_count(list) : 1;
    *memory = pm_arena_array(arena, (size_t)*count, size);
    return pm_arena_status(arena, "a list of a YAML document");
}

pm_status pm_yaml_doubles(pm_yaml list, pm_arena *arena, int *count, double **result) {
    int n;
    void *memory;
    PM_TRY(open_list(list, "a list of numbers", arena, sizeof(double), &n, &memory));
    double *number = memory;
    for (int i = 0; i < n; ++i) {
        PM_TRY(pm_yaml_double(pm_yaml_item_or_self(list, i), -INFINITY, INFINITY, &number[i]));
    }
    *count = n;
    *result = number;
    return PM_OK;
}

pm_status pm_yaml_ints(pm_yaml list, int low, int high, pm_arena *arena, int *count, int **result) {
    int n;
    void *memory;
    PM_TRY(open_list(list, "a list of whole numbers", arena, sizeof(int), &n, &memory));
    int *number = memory;
    for (int i = 0; i < n; ++i) {
        PM_TRY(pm_yaml_int(pm_yaml_item_or_self(list, i), low, high, &number[i]));
    }
    *count = n;
    *result = number;
    return PM_OK;
}

pm_status pm_yaml_texts(pm_yaml list, pm_arena *arena, int *count, const char ***result) {
    int n;
    void *memory;
    PM_TRY(open_list(list, "a list of names", arena, sizeof(char *), &n, &memory));
    const char **text = memory;
    for (int i = 0; i < n; ++i) {
        PM_TRY(pm_yaml_text(pm_yaml_item_or_self(list, i), arena, &text[i]));
    }
    *count = n;
    *result = text;
    return PM_OK;
}

pm_status pm_yaml_vector(pm_yaml list, int count, pm_arena *arena, double *result) {
    int found;
    double *number;
    PM_TRY(pm_yaml_doubles(list, arena, &found, &number));
    if (found != count) {
        return pm_yaml_fail(list, "expected %d numbers, found %d", count, found);
    }
    memcpy(result, number, (size_t)count * sizeof *number);
    return PM_OK;
}

// --- all keys of a mapping ---

pm_status pm_yaml_read(pm_yaml map, pm_arena *arena, const pm_yaml_key *keys) {
    enum { MOST_KEYS = 31 };
    const char *name[MOST_KEYS + 1] = {NULL};
    for (int i = 0; i < MOST_KEYS && keys[i].name != NULL; ++i) {
        name[i] = keys[i].name;
    }
    PM_TRY(pm_yaml_exists(map) ? pm_yaml_allow(map, name) : PM_OK);
    for (const pm_yaml_key *k = keys; k->name != NULL; ++k) {
        pm_yaml value = pm_yaml_get(map, k->name);
        PM_TRY(k->required ? pm_yaml_require(map, k->name, &value) : PM_OK);
        const char **texts = NULL;
        if (k->type == PM_YAML_IS_VALUE) {
            if (k->to.value != NULL) {
                *k->to.value = value;
            }
        } else if (!pm_yaml_exists(value)) {
            continue;
        } else if (k->type == PM_YAML_IS_DOUBLE) {
            PM_TRY(pm_yaml_double(value, k->low, k->high, k->to.number));
        } else if (k->type == PM_YAML_IS_INT) {
            PM_TRY(pm_yaml_int(value, (int)k->low, (int)k->high, k->to.whole));
        } else if (k->type == PM_YAML_IS_BOOL) {
            PM_TRY(pm_yaml_bool(value, k->to.truth));
        } else if (k->type == PM_YAML_IS_TEXT) {
            PM_TRY(pm_yaml_text(value, arena, k->to.text));
        } else if (k->type == PM_YAML_IS_CHOICE) {
            PM_TRY(pm_yaml_choice(value, k->names, k->to.whole));
        } else if (k->type == PM_YAML_IS_VECTOR) {
            PM_TRY(pm_yaml_vector(value, k->length, arena, k->to.number));
        } else {
            PM_TRY(pm_yaml_texts(value, arena, k->count, &texts));
            *k->to.texts = texts;
        }
    }
    return PM_OK;
}

// --- documents ---

// Gives line and column of a byte, counted from 1.
static void locate(const char *text, size_t offset, size_t *line, size_t *column) {
    *line = *column = 1;
    for (size_t i = 0; i < offset; ++i) {
        *column = text[i] == '\n' ? 1 : *column + 1;
        *line += text[i] == '\n';
    }
}

static pm_status fail_syntax(const char *name, const yaml_parser_t *parser, const char *text) {
    size_t line = parser->problem_mark.line + 1;
    size_t column = parser->problem_mark.column + 1;
    if (parser->error == YAML_MEMORY_ERROR) {
        return fail_memory();
    }
    if (parser->error == YAML_READER_ERROR) { // not UTF-8: libyaml knows only the byte's offset
        locate(text, parser->problem_offset, &line, &column);
    }
    return pm_fail(PM_ECONFIG, "%s:%zu:%zu: not valid YAML: %s%s%s", name, line, column,
                   parser->problem != NULL ? parser->problem : "syntax error",
                   parser->context != NULL ? " " : "",
                   parser->context != NULL ? parser->context : "");
}

static pm_status adopt_child(pm_yaml_document *document, int parent, int key, int child) {
    const bool taken = child == 1 || document->parent[child] != 0;
    if (taken) {
        return pm_yaml_fail(
            (pm_yaml){document, child},
            "an alias (*name) refers to this value; aliases are not supported, repeat the "
            "value");
    }
    document->parent[child] = parent;
    document->key[child] = key;
    return PM_OK;
}

// Checks every node and notes its place. It visits the nodes in the order of libyaml's table
// instead of by recursion, so that deep nesting costs no stack.
static pm_status adopt(pm_yaml_document *document) {
    const size_t count = (size_t)(document->yaml.nodes.top - document->yaml.nodes.start);
    document->parent = pm_arena_array(&document->arena, count + 1, sizeof *document->parent);
    document->key = pm_arena_array(&document->arena, count + 1, sizeof *document->key);
    PM_TRY(pm_arena_status(&document->arena, "a YAML document"));
    for (int id = 1; id <= (int)count; ++id) {
        const pm_yaml value = {document, id};
        for (int i = 0; pm_yaml_is_list(value) && i < pm_yaml_count(value); ++i) {
            PM_TRY(adopt_child(document, id, 0, pm_yaml_item(value, i).node));
        }
        if (!pm_yaml_is_map(value)) {
            continue;
        }
        const yaml_node_pair_t *pair = node_of(value)->data.mapping.pairs.start;
        const int npair = pm_yaml_count(value);
        if (npair > MAX_ENTRIES) {
            return pm_yaml_fail(value, "the mapping has %d entries, expected at most %d", npair,
                                MAX_ENTRIES);
        }
        for (int i = 0; i < npair; ++i) {
            PM_TRY(adopt_child(document, id, 0, pair[i].key));
            const pm_yaml key = {document, pair[i].key};
            const char *text = scalar_of(key);
            if (text == NULL) {
                return fail_expected(key, "a plain key");
            }
            for (int j = 0; j < i; ++j) {
                if (strcmp(text, scalar_of(sibling_of(key, pair[j].key))) == 0) {
                    return pm_yaml_fail(key, "duplicate key \"%.64s\"", text);
                }
            }
            PM_TRY(adopt_child(document, id, pair[i].key, pair[i].value));
        }
    }
    for (int id = 1; id <= (int)count; ++id) {
        static const char standard[] = "tag:yaml.org,2002:";
        const pm_yaml value = {document, id};
        const yaml_node_t *node = node_of(value);
        const char *tag = (const char *)node->tag, *text = scalar_of(value);
        if (tag == NULL || strncmp(tag, standard, sizeof standard - 1) != 0) {
            return pm_yaml_fail(value, "tags are not supported, found %.64s",
                                tag == NULL ? "!" : tag);
        }
        // libyaml terminates the UTF-8 text by a zero. Line ends of YAML are also U+0080 to U+009F,
        // U+2028 and U+2029.
        for (size_t i = 0; text != NULL && i < node->data.scalar.length; ++i) {
            const unsigned char *c = (const unsigned char *)text + i;
            if (c[0] < ' ' || c[0] == 0x7f || (c[0] == 0xc2 && c[1] < 0xa0) ||
                (c[0] == 0xe2 && c[1] == 0x80 && (c[2] == 0xa8 || c[2] == 0xa9))) {
                return pm_yaml_fail(value,
                                    "text must stand on one line without control characters");
            }
        }
    }
    return PM_OK;
}

static pm_status parse(pm_yaml_document **result, const char *text, size_t size, const char *name,
                       pm_yaml *root) {
    static const char brackets[] = "[]{}";
    yaml_parser_t parser;
    yaml_document_t rest;
    bool parses = false;
    pm_status status = PM_OK;
    int depth = 0;
    if (size > MAX_BYTES) {
        return pm_fail(PM_ECONFIG, "%s: larger than %zu bytes, so not a configuration", name,
                       MAX_BYTES);
    }
    // Counts brackets in text and comments, too, of which a configuration has few, and stops at a
    // NUL, beyond which libyaml does not read.
    for (const char *at = strpbrk(text, brackets); at != NULL; at = strpbrk(at + 1, brackets)) {
        const bool opens = *at == '[' || *at == '{';
        depth = opens ? depth + 1 : depth > 0 ? depth - 1 : 0;
        if (depth > MAX_BRACKETS) {
            size_t line, column;
            locate(text, (size_t)(at - text), &line, &column);
            return pm_fail(PM_ECONFIG, "%s:%zu:%zu: more than %d brackets are open at once", name,
                           line, column, MAX_BRACKETS);
        }
    }
    pm_yaml_document *document = calloc(1, sizeof *document);
    PM_TRY(pm_allocated(document, "a YAML document"));
    document->name = pm_arena_strdup(&document->arena, name);
    document->text = pm_arena_strdup(&document->arena, text);
    PM_TRY_DONE(pm_arena_status(&document->arena, "a YAML document"));
    parses = yaml_parser_initialize(&parser);
    PM_TRY_DONE(parses ? PM_OK : fail_memory());
    yaml_parser_set_encoding(&parser, YAML_UTF8_ENCODING);
    yaml_parser_set_input_string(&parser, (const unsigned char *)text, size);
    document->composed = yaml_parser_load(&parser, &document->yaml);
    PM_TRY_DONE(document->composed ? PM_OK : fail_syntax(name, &parser, text));
    if (yaml_document_get_root_node(&document->yaml) == NULL) {
        PM_TRY_DONE(pm_fail(PM_ECONFIG, "%s:1:1: empty, expected a mapping", name));
    }
    PM_TRY_DONE(yaml_parser_load(&parser, &rest) ? PM_OK : fail_syntax(name, &parser, text));
    const yaml_node_t *second = yaml_document_get_root_node(&rest);
    if (second != NULL) {
        status =
            pm_fail(PM_ECONFIG, "%s:%zu:%zu: expected the end of the file, found a second document",
                    name, second->start_mark.line + 1, second->start_mark.column + 1);
    }
    yaml_document_delete(&rest);
    PM_TRY_DONE(status);
    PM_TRY_DONE(adopt(document));
    *root = (pm_yaml){document, 1};
    *result = document;
    document = NULL;
done:
    if (parses) {
        yaml_parser_delete(&parser);
    }
    pm_yaml_close(document);
    return status;
}

// --- changes ---

static size_t first_of(const pm_yaml_change *change) {
    return node_of(change->at)->start_mark.index;
}

// Writes the characters [*at, end) of a text in UTF-8, or with a NULL file skips them.
static void copy_characters(const char **text, size_t *at, size_t end, FILE *file) {
    while (*at < end && **text != '\0') {
        do {
            if (file != NULL) {
                fputc(**text, file);
            }
            ++*text;
        } while (((unsigned char)**text & 0xc0) == 0x80); // the rest of a character
        ++*at;
    }
}

void pm_yaml_write_changed(const pm_yaml_document *document, int count, pm_yaml_change *change,
                           FILE *file) {
    const char *text = document->text;
    size_t at = 0;                    // libyaml counts characters
    for (int i = 1; i < count; ++i) { // in the order of the text, what is equal as it was given
        const pm_yaml_change own = change[i];
        int k = i;
        for (; k > 0 && first_of(&change[k - 1]) > first_of(&own); --k) {
            change[k] = change[k - 1];
        }
        change[k] = own;
    }
    for (int i = 0; i < count; ++i) {
        const pm_yaml_change *c = &change[i];
        const yaml_node_t *node = node_of(c->at);
        const bool list = pm_yaml_is_list(c->at), map = pm_yaml_is_map(c->at);
        const bool block = (list && node->data.sequence.style != YAML_FLOW_SEQUENCE_STYLE) ||
                           (map && node->data.mapping.style != YAML_FLOW_MAPPING_STYLE);
        // In a block each entry has a line of its own.
        const yaml_mark_t next = c->replaces ? node->end_mark : node->start_mark;
        copy_characters(&text, &at, first_of(c), file);
        copy_characters(&text, &at, first_of(c) + !(block || c->replaces), file); // a bracket
        copy_characters(&text, &at, c->replaces ? next.index : at, NULL);
        fprintf(file, "%s%s%s", list && block && !c->replaces ? "- " : "", c->text,
                block         ? "\n"
                : c->replaces ? ""
                              : ", ");
        fprintf(file, "%*s", block ? (int)next.column : 0, "");
    }
    fputs(text, file);
}

pm_status pm_yaml_parse(pm_yaml_document **document, const char *text, const char *name,
                        pm_yaml *root) {
    return parse(document, text, strlen(text), name, root);
}

pm_status pm_yaml_open(pm_yaml_document **document, const char *path, pm_yaml *root) {
    PM_TRY(pm_files_check_input(path));
    FILE *file = fopen(path, "rb");
    if (file == NULL) {
        return pm_fail(PM_EFILE, "%s: cannot open: %s", path, strerror(errno));
    }
    // Room for a byte more than parse() allows, and for a terminator. The system gives memory only
    // to the pages that are read into.
    char *text = malloc(MAX_BYTES + 2);
    const size_t size = text == NULL ? 0 : fread(text, 1, MAX_BYTES + 1, file);
    pm_status status = PM_OK;
    if (text == NULL) {
        status = fail_memory();
    } else if (ferror(file)) {
        status = pm_fail(PM_EFILE, "%s: cannot read: %s", path, strerror(errno));
    } else {
        text[size] = '\0';
        status = parse(document, text, size, path, root);
    }
    free(text);
    fclose(file);
    pm_files_note_input(path);
    return status;
}

void pm_yaml_close(pm_yaml_document *document) {
    if (document == NULL) {
        return;
    }
    if (document->composed) {
        yaml_document_delete(&document->yaml);
    }
    PM_DELETE(document);
}
