// Opens a YAML document. libyaml composes it; adopt() then checks that it is a tree of mappings,
// lists and single lines of text, and notes the place of every value in it, so that the readers can
// walk it without further checks and an error can name the key.
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "store/yaml_document.h"

#define MAX_BYTES \
    ((size_t)1 << 20)    // far above any configuration; limits the work that hostile text can cause
#define FIRST_BYTES 4096 // read at first; most configurations are smaller
#define MAX_BRACKETS 200 // open at once; the time of libyaml grows with the square of the depth
#define MAX_ENTRIES 10000 // of one mapping; its keys are compared pairwise

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
        return pm_yaml_fail_memory();
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

static pm_status adopt_map(pm_yaml_document *document, int id) {
    const pm_yaml map = {document, id};
    const yaml_node_pair_t *pair = pm_yaml_node(map)->data.mapping.pairs.start;
    const int count = pm_yaml_count(map);
    if (count > MAX_ENTRIES) {
        return pm_yaml_fail(map, "the mapping has %d entries, expected at most %d", count,
                            MAX_ENTRIES);
    }
    for (int i = 0; i < count; ++i) {
        PM_TRY(adopt_child(document, id, 0, pair[i].key));
        const pm_yaml key = {document, pair[i].key};
        const char *text = pm_yaml_scalar(key);
        if (text == NULL) {
            return pm_yaml_fail_expected(key, "a plain key");
        }
        for (int j = 0; j < i; ++j) {
            if (strcmp(text, pm_yaml_scalar(pm_yaml_sibling(key, pair[j].key))) == 0) {
                return pm_yaml_fail(key, "duplicate key \"%.64s\"", text);
            }
        }
        PM_TRY(adopt_child(document, id, pair[i].key, pair[i].value));
    }
    return PM_OK;
}

// Returns true if UTF-8 text begins with a control character or with a line end of YAML: U+0080 to
// U+009F, U+2028 and U+2029.
static bool is_control(const char *text) {
    const unsigned char *c = (const unsigned char *)text;
    return c[0] < ' ' || c[0] == 0x7f || (c[0] == 0xc2 && c[1] < 0xa0) ||
           (c[0] == 0xe2 && c[1] == 0x80 && (c[2] == 0xa8 || c[2] == 0xa9));
}

static pm_status check_scalar(pm_yaml value) {
    const yaml_node_t *node = pm_yaml_node(value);
    for (size_t i = 0; i < node->data.scalar.length; ++i) { // libyaml terminates it by a zero
        if (is_control((const char *)node->data.scalar.value + i)) {
            return pm_yaml_fail(value, "text must stand on one line without control characters");
        }
    }
    return PM_OK;
}

static pm_status check_tag(pm_yaml value) {
    static const char standard[] = "tag:yaml.org,2002:";
    const char *tag = (const char *)pm_yaml_node(value)->tag;
    if (tag == NULL || strncmp(tag, standard, sizeof standard - 1) != 0) {
        return pm_yaml_fail(value, "tags are not supported, found %.64s", tag == NULL ? "!" : tag);
    }
    return PM_OK;
}

// Checks every node and notes its place. It visits the nodes in the order of libyaml's table
// instead of by recursion, so that deep nesting costs no stack.
static pm_status adopt(pm_yaml_document *document) {
    const size_t count = (size_t)(document->yaml.nodes.top - document->yaml.nodes.start);
    document->parent = pm_arena_array(&document->arena, count + 1, sizeof *document->parent);
    document->key = pm_arena_array(&document->arena, count + 1, sizeof *document->key);
    if (document->parent == NULL || document->key == NULL) {
        return pm_yaml_fail_memory();
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
        if (pm_yaml_scalar(value) != NULL) {
            PM_TRY(check_scalar(value));
        }
    }
    return PM_OK;
}

// Fails if a second document follows the first one.
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

// Limits the number of open brackets. It counts brackets in text and comments too, of which a
// configuration has few, and stops at a NUL, beyond which libyaml does not read.
static pm_status check_depth(const char *name, const char *text) {
    static const char brackets[] = "[]{}";
    int depth = 0;
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
    return PM_OK;
}

static pm_status compose(pm_yaml_document *document, const char *text, size_t size) {
    pm_status status = PM_OK;
    yaml_parser_t parser;
    PM_TRY(check_depth(document->name, text));
    if (!yaml_parser_initialize(&parser)) {
        return pm_yaml_fail_memory();
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
        return pm_fail(PM_ECONFIG, "%s: larger than %zu bytes, so not a configuration", name,
                       MAX_BYTES);
    }
    pm_yaml_document *document = calloc(1, sizeof *document);
    if (document == NULL) {
        return pm_yaml_fail_memory();
    }
    document->name = pm_arena_strdup(&document->arena, name);
    const pm_status status =
        document->name == NULL ? pm_yaml_fail_memory() : compose(document, text, size);
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

// Reads a file's text and terminates it by a NUL. Memory doubles until the text fits or exceeds the
// bytes that parse() allows. The caller frees `text`, on failure too.
static pm_status read_text(FILE *file, const char *path, char **text, size_t *size) {
    size_t room = 0;
    *text = NULL;
    *size = 0;
    while (*size + 1 >= room && *size <= MAX_BYTES) {
        room = room == 0 ? FIRST_BYTES : 2 * room;
        char *larger = realloc(*text, room);
        if (larger == NULL) {
            return pm_yaml_fail_memory();
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
