// Shortens the formulas of a proposal: names that stand for zero vanish, with what they multiply.
#ifndef PM_TRAINER_PROPOSE_LOGGER_SHORTEN_H
#define PM_TRAINER_PROPOSE_LOGGER_SHORTEN_H

#include <ctype.h>
#include <string.h>

#include "base/arena.h"

// Returns the lines of a model without the names `zero` [count] in the formulas between quotes
// (model/formula.h), where each stands for 0: "(0 + a*x)*exp(b*y)" becomes "a*x" where b is zero. A
// term of a list that vanishes is left out, unless it is the last one. What is no formula stays as
// it is. The arena owns the result. NULL: out of memory.
const char *pm_logger_shorten(pm_arena *arena, const char *body, int count,
                              const char *const *zero);

static inline bool pm_logger_is_of_name(char c) {
    return isalnum((unsigned char)c) || c == '_' || c == '.';
}

// Returns true if the text mentions a name, apart from longer names.
static inline bool pm_logger_mentions(const char *text, const char *name) {
    const size_t length = strlen(name);
    for (const char *at = strstr(text, name); at != NULL; at = strstr(at + 1, name)) {
        if ((at == text || !pm_logger_is_of_name(at[-1])) && !pm_logger_is_of_name(at[length])) {
            return true;
        }
    }
    return false;
}

#endif
