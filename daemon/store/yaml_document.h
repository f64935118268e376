// Declarations shared by the YAML files of this folder: the composed document, and failures that
// several of them report. yaml_open.c makes the document, yaml.c walks it, yaml_value.c reads its
// scalars.
#ifndef PM_STORE_YAML_DOCUMENT_H
#define PM_STORE_YAML_DOCUMENT_H

#include <stddef.h>
#include <yaml.h>

#include "store/yaml.h"

struct pm_yaml_document {
    pm_arena arena;
    const char *name; // of the file, for errors
    bool composed;    // `yaml` must be deleted
    yaml_document_t yaml;
    int *parent; // [node] the list or mapping that contains the node
    int *key;    // [node] the key whose value the node is; 0: the node has no key
};

// Returns libyaml's node of a value; NULL for an absent value.
static inline const yaml_node_t *pm_yaml_node(pm_yaml value) {
    return value.node == 0 ? NULL : &value.document->yaml.nodes.start[value.node - 1];
}

// Returns the text of a scalar; NULL for a list, a mapping or an absent value.
static inline const char *pm_yaml_scalar(pm_yaml value) {
    const yaml_node_t *node = pm_yaml_node(value);
    return node != NULL && node->type == YAML_SCALAR_NODE ? (const char *)node->data.scalar.value
                                                          : NULL;
}

// Returns the value that stands at `node` of the document to which `value` belongs.
static inline pm_yaml pm_yaml_sibling(pm_yaml value, int node) {
    return (pm_yaml){value.document, node};
}

// Returns the position of a scalar among the NULL-terminated `names`; -1 if it is none of them.
int pm_yaml_position(const char *const *names, pm_yaml value);

// Joins the NULL-terminated names to "a, b, c" in `buffer`, cut to `size`. Returns `buffer`.
const char *pm_yaml_join(const char *const *names, char *buffer, size_t size);

// Fails with "expected <what>, found <the value>". PM_ECONFIG.
pm_status pm_yaml_fail_expected(pm_yaml value, const char *what);

// Fails with PM_ENOMEM.
pm_status pm_yaml_fail_memory(void);

#endif
