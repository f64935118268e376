// The YAML reader: libyaml composes a document; adopt() then makes sure that it is a tree of maps,
// lists and plain lines of text, and remembers every value's place in it, so that what follows can
// walk it without care and an error can name the key.
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

#define MAX_BYTES ((size_t)1 << 20) // far above any configuration; bounds the work of hostile text
#define FIRST_BYTES 4096            // of a file: most configurations are smaller
#define MAX_BRACKETS 200  // open at once; libyaml's time grows with the square of the depth
#define MAX_ENTRIES 10000 // of one mapping, whose keys are compared pairwise

struct pm_yaml_document {
    pm_arena arena;
    const char *name;
    bool composed;
    yaml_document_t yaml;
    int *parent; // [node] the list or mapping it stands in
    int *key;    // [node] the key it stands under; 0: none
};

static const yaml_node_t *node_of(pm_yaml value) {
    return value.node == 0 ? NULL : &value.document->yaml.nodes.start[value.node - 1];
}

static bool has_type(pm_yaml value, yaml_node_type_t type) {
    const yaml_node_t *node = node_of(value);
    return node != NULL && node->type == type;
}

static const char *scalar_text(pm_yaml value) {
    return has_type(value, YAML_SCALAR_NODE) ? (const char *)node_of(value)->data.scalar.value
                                             : NULL;
}

static pm_yaml sibling(pm_yaml value, int node) {
    return (pm_yaml){value.document, node};
}

// --- errors ---

// The text of the key under which the value, or the list it is an item of, stands; "" for none.
static const char *label_of(pm_yaml at) {
    while (at.node != 0 && at.document->key[at.node] == 0) {
        at.node = at.document->parent[at.node];
    }
    return at.node == 0 ? "" : scalar_text(sibling(at, at.document->key[at.node]));
}

pm_status pm_yaml_fail(pm_yaml at, const char *format, ...) {
    char text[768];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    const yaml_node_t *node = node_of(at);
    const char *label = label_of(at);
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

static pm_status no_memory(void) {
    return pm_fail(PM_ENOMEM, "out of memory while reading YAML");
}

// "expected <what>, found <what stands there>"
static pm_status fail_expected(pm_yaml value, const char *what) {
    const char *text = scalar_text(value);
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

// --- opening ---

// Line and column of a byte, counted from 1.
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
        return no_memory();
    }
    if (parser->error == YAML_READER_ERROR) { // a byte that no text has: only its offset is known
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
        return pm_yaml_fail((pm_yaml){document, child},
                            "an alias (*name) refers to this; aliases are not supported, write the "
                            "value again");
    }
    document->parent[child] = parent;
    document->key[child] = key;
    return PM_OK;
}

static pm_status adopt_map(pm_yaml_document *document, int id) {
    const pm_yaml map = {document, id};
    const yaml_node_pair_t *pair = node_of(map)->data.mapping.pairs.start;
    const int count = pm_yaml_count(map);
    if (count > MAX_ENTRIES) {
        return pm_yaml_fail(map, "%d entries, at most %d are possible", count, MAX_ENTRIES);
    }
    for (int i = 0; i < count; ++i) {
        PM_TRY(adopt_child(document, id, 0, pair[i].key));
        const pm_yaml key = {document, pair[i].key};
        const char *text = scalar_text(key);
        if (text == NULL) {
            return fail_expected(key, "a plain key");
        }
        for (int j = 0; j < i; ++j) {
            if (strcmp(text, scalar_text(sibling(key, pair[j].key))) == 0) {
                return pm_yaml_fail(key, "duplicate key \"%.64s\"", text);
            }
        }
        PM_TRY(adopt_child(document, id, pair[i].key, pair[i].value));
    }
    return PM_OK;
}

// Whether UTF-8 begins with a control character, or with what YAML takes for the end of a line,
// too: U+0080 to U+009F, U+2028 and U+2029.
static bool is_control(const char *text) {
    const unsigned char *c = (const unsigned char *)text;
    return c[0] < ' ' || c[0] == 0x7f || (c[0] == 0xc2 && c[1] < 0xa0) ||
           (c[0] == 0xe2 && c[1] == 0x80 && (c[2] == 0xa8 || c[2] == 0xa9));
}

static pm_status check_scalar(pm_yaml value) {
    const yaml_node_t *node = node_of(value);
    for (size_t i = 0; i < node->data.scalar.length; ++i) { // a zero stands behind it
        if (is_control((const char *)node->data.scalar.value + i)) {
            return pm_yaml_fail(value,
                                "text must stand on one line and hold no control characters");
        }
    }
    return PM_OK;
}

static pm_status check_tag(pm_yaml value) {
    static const char standard[] = "tag:yaml.org,2002:";
    const char *tag = (const char *)node_of(value)->tag;
    if (tag == NULL || strncmp(tag, standard, sizeof standard - 1) != 0) {
        return pm_yaml_fail(value, "tags are not supported, found %.64s", tag == NULL ? "!" : tag);
    }
    return PM_OK;
}

// Checks every node and remembers its place. Nodes are visited in the order of libyaml's table, so
// no depth of nesting matters.
static pm_status adopt(pm_yaml_document *document) {
    const size_t count = (size_t)(document->yaml.nodes.top - document->yaml.nodes.start);
    document->parent = pm_arena_array(&document->arena, count + 1, sizeof *document->parent);
    document->key = pm_arena_array(&document->arena, count + 1, sizeof *document->key);
    if (document->parent == NULL || document->key == NULL) {
        return no_memory();
    }
    for (int id = 1; id <= (int)count; ++id) {
        const pm_yaml value = {document, id};
        for (int i = 0; pm_yaml_is_list(value) && i < pm_yaml_count(value); ++i) {
            PM_TRY(adopt_child(document, id, 0, pm_yaml_item(value, i).node));
        }
        if (pm_yaml_is_map(value)) {
            PM_TRY(adopt_map(document, id));
        }
    }
    for (int id = 1; id <= (int)count; ++id) {
        const pm_yaml value = {document, id};
        PM_TRY(check_tag(value));
        if (scalar_text(value) != NULL) {
            PM_TRY(check_scalar(value));
        }
    }
    return PM_OK;
}

// After the first document nothing may follow.
static pm_status check_end(yaml_parser_t *parser, const char *name, const char *text) {
    yaml_document_t rest;
    if (!yaml_parser_load(parser, &rest)) {
        return fail_syntax(name, parser, text);
    }
    const yaml_node_t *root = yaml_document_get_root_node(&rest);
    const size_t line = root == NULL ? 0 : root->start_mark.line + 1;
    const size_t column = root == NULL ? 0 : root->start_mark.column + 1;
    yaml_document_delete(&rest);
    if (line != 0) {
        return pm_fail(PM_ECONFIG,
                       "%s:%zu:%zu: expected the end of the file, found a second document", name,
                       line, column);
    }
    return PM_OK;
}

// Counts brackets wherever they stand, in text and comments too: a configuration has few of either.
// Nothing behind a NUL counts, since libyaml reads no further.
static pm_status check_depth(const char *name, const char *text) {
    static const char brackets[] = "[]{}";
    int depth = 0;
    for (const char *at = strpbrk(text, brackets); at != NULL; at = strpbrk(at + 1, brackets)) {
        const bool opens = *at == '[' || *at == '{';
        depth = opens ? depth + 1 : depth > 0 ? depth - 1 : 0;
        if (depth > MAX_BRACKETS) {
            size_t line, column;
            locate(text, (size_t)(at - text), &line, &column);
            return pm_fail(PM_ECONFIG, "%s:%zu:%zu: more than %d brackets open at once", name, line,
                           column, MAX_BRACKETS);
        }
    }
    return PM_OK;
}

static pm_status compose(pm_yaml_document *document, const char *text, size_t size) {
    pm_status status = PM_OK;
    yaml_parser_t parser;
    PM_TRY(check_depth(document->name, text));
    if (!yaml_parser_initialize(&parser)) {
        return no_memory();
    }
    yaml_parser_set_encoding(&parser, YAML_UTF8_ENCODING);
    yaml_parser_set_input_string(&parser, (const unsigned char *)text, size);
    if (!yaml_parser_load(&parser, &document->yaml)) {
        status = fail_syntax(document->name, &parser, text);
        goto done;
    }
    document->composed = true;
    if (yaml_document_get_root_node(&document->yaml) == NULL) {
        status = pm_fail(PM_ECONFIG, "%s:1:1: empty, expected a mapping", document->name);
        goto done;
    }
    PM_TRY_DONE(check_end(&parser, document->name, text));
    status = adopt(document);
done:
    yaml_parser_delete(&parser);
    return status;
}

static pm_status parse(pm_yaml_document **result, const char *text, size_t size, const char *name,
                       pm_yaml *root) {
    if (size > MAX_BYTES) {
        return pm_fail(PM_ECONFIG, "%s: larger than %zu bytes, not a configuration", name,
                       MAX_BYTES);
    }
    pm_yaml_document *document = calloc(1, sizeof *document);
    if (document == NULL) {
        return no_memory();
    }
    document->name = pm_arena_strdup(&document->arena, name);
    const pm_status status = document->name == NULL ? no_memory() : compose(document, text, size);
    if (status != PM_OK) {
        pm_yaml_close(document);
        return status;
    }
    *result = document;
    *root = (pm_yaml){document, 1};
    return PM_OK;
}

pm_status pm_yaml_parse(pm_yaml_document **document, const char *text, const char *name,
                        pm_yaml *root) {
    return parse(document, text, strlen(text), name, root);
}

// A file's text with a NUL behind it, in memory that doubles until it is enough, or until parse()
// will see that there is more than allowed. The caller frees `text`, whatever comes back.
static pm_status read_text(FILE *file, const char *path, char **text, size_t *size) {
    size_t room = 0;
    *text = NULL;
    *size = 0;
    while (*size + 1 >= room && *size <= MAX_BYTES) {
        room = room == 0 ? FIRST_BYTES : 2 * room;
        char *larger = realloc(*text, room);
        if (larger == NULL) {
            return no_memory();
        }
        *text = larger;
        *size += fread(*text + *size, 1, room - 1 - *size, file);
    }
    (*text)[*size] = '\0';
    return ferror(file) ? pm_fail(PM_EFILE, "%s: cannot read: %s", path, strerror(errno)) : PM_OK;
}

pm_status pm_yaml_open(pm_yaml_document **document, const char *path, pm_yaml *root) {
    char *text;
    size_t size;
    FILE *file = fopen(path, "rb");
    if (file == NULL) {
        return pm_fail(PM_EFILE, "%s: cannot open: %s", path, strerror(errno));
    }
    pm_status status = read_text(file, path, &text, &size);
    if (status == PM_OK) {
        status = parse(document, text, size, path, root);
    }
    free(text);
    fclose(file);
    return status;
}

void pm_yaml_close(pm_yaml_document *document) {
    if (document == NULL) {
        return;
    }
    if (document->composed) {
        yaml_document_delete(&document->yaml);
    }
    pm_arena_free(&document->arena);
    free(document);
}

// --- walking ---

bool pm_yaml_exists(pm_yaml value) {
    return value.node != 0;
}

bool pm_yaml_is_map(pm_yaml value) {
    return has_type(value, YAML_MAPPING_NODE);
}

bool pm_yaml_is_list(pm_yaml value) {
    return has_type(value, YAML_SEQUENCE_NODE);
}

bool pm_yaml_is_text(pm_yaml value, const char *text) {
    const char *own = scalar_text(value);
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
    return sibling(list, node_of(list)->data.sequence.items.start[i]);
}

void pm_yaml_entry(pm_yaml map, int i, pm_yaml *key, pm_yaml *value) {
    const yaml_node_pair_t *pair = &node_of(map)->data.mapping.pairs.start[i];
    *key = sibling(map, pair->key);
    *value = sibling(map, pair->value);
}

pm_yaml pm_yaml_get(pm_yaml map, const char *key) {
    for (int i = 0; pm_yaml_is_map(map) && i < pm_yaml_count(map); ++i) {
        pm_yaml own, value;
        pm_yaml_entry(map, i, &own, &value);
        if (pm_yaml_is_text(own, key)) {
            return value;
        }
    }
    return sibling(map, 0);
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

// "a, b, c" for messages.
static const char *joined(const char *const *names, char *buffer, size_t size) {
    size_t used = 0;
    buffer[0] = '\0';
    for (int i = 0; names[i] != NULL && used < size; ++i) {
        used += (size_t)snprintf(buffer + used, size - used, "%s%s", i == 0 ? "" : ", ", names[i]);
    }
    return buffer;
}

static int position_in(const char *const *names, pm_yaml value) {
    for (int i = 0; names[i] != NULL; ++i) {
        if (pm_yaml_is_text(value, names[i])) {
            return i;
        }
    }
    return -1;
}

// Keys that files were written with before, and the names they have now.
static const struct {
    const char *before, *now;
} renamed[] = {
    {"loads", "boundary_inputs"}, {"images", "derived"},     {"rest", "zero_at_origin"},
    {"section", "symmetry"},      {"swing", "inertia_time"}, {"region", "training_range"},
};

static bool is_among(const char *const *keys, const char *key) {
    for (int i = 0; keys[i] != NULL; ++i) {
        if (strcmp(keys[i], key) == 0) {
            return true;
        }
    }
    return false;
}

static pm_status fail_unknown(pm_yaml key, const char *const *keys) {
    for (size_t i = 0; i < sizeof renamed / sizeof renamed[0]; ++i) {
        if (pm_yaml_is_text(key, renamed[i].before) && is_among(keys, renamed[i].now)) {
            return pm_yaml_fail(key, "the key \"%s\" is called \"%s\" now", renamed[i].before,
                                renamed[i].now);
        }
    }
    char list[512];
    return pm_yaml_fail(key, "unknown key \"%.64s\"; allowed: %s", scalar_text(key),
                        joined(keys, list, sizeof list));
}

pm_status pm_yaml_allow(pm_yaml map, const char *const *keys) {
    if (!pm_yaml_is_map(map)) {
        return fail_expected(map, "a mapping");
    }
    for (int i = 0; i < pm_yaml_count(map); ++i) {
        pm_yaml key, value;
        pm_yaml_entry(map, i, &key, &value);
        if (position_in(keys, key) < 0) {
            return fail_unknown(key, keys);
        }
    }
    return PM_OK;
}

pm_status pm_yaml_require_entries(pm_yaml map) {
    return pm_yaml_is_map(map) && pm_yaml_count(map) > 0
               ? PM_OK
               : fail_expected(map, "a mapping with at least one entry");
}

// --- scalars ---

// The text if it is a number's: written plainly and of these characters only, which leaves out
// hexadecimal, infinities and NaN.
static const char *number_text(pm_yaml value, const char *characters) {
    const char *text = scalar_text(value);
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
    const long number = text == NULL ? 0 : strtol(text, &end, 10); // saturates: caught by the range
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
    const char *text = scalar_text(value);
    if (text == NULL || *text == '\0') {
        return fail_expected(value, "text");
    }
    const char *copy = pm_arena_strdup(arena, text);
    if (copy == NULL) {
        return no_memory();
    }
    *result = copy;
    return PM_OK;
}

pm_status pm_yaml_choice(pm_yaml value, const char *const *names, int *result) {
    const int choice = position_in(names, value);
    if (choice < 0) {
        char list[512], what[600];
        snprintf(what, sizeof what, "one of %s", joined(names, list, sizeof list));
        return fail_expected(value, what);
    }
    *result = choice;
    return PM_OK;
}

// --- lists of scalars ---

// The number of entries, and memory for them of `size` bytes each.
static pm_status open_list(pm_yaml list, const char *what, pm_arena *arena, size_t size, int *count,
                           void **memory) {
    const bool is_list = pm_yaml_is_list(list);
    if (!is_list && scalar_text(list) == NULL) {
        return fail_expected(list, what);
    }
    *count = is_list ? pm_yaml_count(list) : 1;
    *memory = pm_arena_array(arena, (size_t)*count, size);
    return *memory == NULL ? no_memory() : PM_OK;
}

static pm_yaml list_entry(pm_yaml list, int i) {
    return pm_yaml_is_list(list) ? pm_yaml_item(list, i) : list;
}

pm_status pm_yaml_doubles(pm_yaml list, pm_arena *arena, int *count, double **result) {
    int n;
    void *memory;
    PM_TRY(open_list(list, "a list of numbers", arena, sizeof(double), &n, &memory));
    double *number = memory;
    for (int i = 0; i < n; ++i) {
        PM_TRY(pm_yaml_double(list_entry(list, i), -INFINITY, INFINITY, &number[i]));
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
        PM_TRY(pm_yaml_int(list_entry(list, i), low, high, &number[i]));
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
        PM_TRY(pm_yaml_text(list_entry(list, i), arena, &text[i]));
    }
    *count = n;
    *result = text;
    return PM_OK;
}
