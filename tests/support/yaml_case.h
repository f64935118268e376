// A test case with a mistake for the YAML readers: an edit to a valid text, and the place and words
// of the expected error.
#ifndef PM_TESTS_YAML_CASE_H
#define PM_TESTS_YAML_CASE_H

#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/status.h"
#include "tests/support/unit.h"

typedef struct yaml_case {
    const char *from, *to; // the first `from` in the valid text becomes `to`
    const char *at;        // the error points at this part of `to`
    const char *words;     // and contains these words
} yaml_case;

// Returns the edited text; the caller frees it.
static inline char *yaml_case_text(const char *good, const yaml_case *c) {
    const char *place = strstr(good, c->from);
    if (place == NULL) {
        fail_msg("the good text has no \"%s\"", c->from);
        abort();
    }
    char *text = malloc(strlen(good) + strlen(c->to) + 1);
    if (text == NULL) {
        abort();
    }
    memcpy(text, good, (size_t)(place - good));
    stpcpy(stpcpy(text + (place - good), c->to), place + strlen(c->from));
    return text;
}

// Compares `status` and pm_error(), after the edited text was read under the name `file`, with the
// expected error. Prints a difference and returns false if there is one.
static inline bool yaml_case_holds(const char *file, const char *good, const yaml_case *c,
                                   pm_status status) {
    char *text = yaml_case_text(good, c);
    const char *change = text + (strstr(good, c->from) - good);
    const char *at = strstr(change, c->at);
    int line = 1, column = 1;
    for (const char *p = text; p != at; ++p) {
        column = *p == '\n' ? 1 : column + 1;
        line += *p == '\n';
    }
    char place[256];
    snprintf(place, sizeof place, "%s:%d:%d: ", file, line, column);
    free(text);
    const bool holds = status == PM_ECONFIG && strncmp(pm_error(), place, strlen(place)) == 0 &&
                       strstr(pm_error(), c->words) != NULL && strchr(pm_error(), '\n') == NULL;
    if (!holds) {
        print_error("\"%s\" -> \"%s\": status %d, error \"%s\"; expected %d, \"%s\" and \"%s\"\n",
                    c->from, c->to, status, pm_error(), PM_ECONFIG, place, c->words);
    }
    return holds;
}

#endif
