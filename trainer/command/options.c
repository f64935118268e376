// Reading a command line from its table.
#include "command/options.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static void print_option(const char *brief, const char *name, const char *value, const char *help) {
    char left[64];
    snprintf(left, sizeof left, "%s%s%s%s%s", brief == NULL ? "    " : brief,
             brief == NULL ? "" : ", ", name, value == NULL ? "" : " ", value == NULL ? "" : value);
    printf("  %-26s %s\n", left, help);
}

static void print_help(const pm_options *options) {
    printf("Usage: %s\n\n%s\n\nOptions:\n", options->usage, options->summary);
    for (int i = 0; i < options->count; ++i) {
        const pm_option *o = &options->option[i];
        print_option(o->brief, o->name, o->value, o->help);
    }
    print_option("-h", "--help", NULL, "print this and exit");
}

// The option that `argument` names, and the value glued to it by '='; NULL if there is none.
static const pm_option *find(const pm_options *options, const char *argument, const char **glued) {
    const char *equals = strchr(argument, '=');
    const size_t length = equals == NULL ? strlen(argument) : (size_t)(equals - argument);
    *glued = equals == NULL ? NULL : equals + 1;
    for (int i = 0; i < options->count; ++i) {
        const pm_option *o = &options->option[i];
        const bool named = strlen(o->name) == length && strncmp(o->name, argument, length) == 0;
        if (named || (o->brief != NULL && strcmp(o->brief, argument) == 0)) {
            return o;
        }
    }
    return NULL;
}

static pm_status take(const pm_options *options, int argc, char **argv, int *i) {
    const char *argument = argv[*i], *glued;
    if (argument[0] != '-') {
        int k = 0;
        while (options->positional[k] != NULL) {
            if (++k >= options->most) {
                return pm_fail(PM_EUSAGE, "%s: unexpected argument \"%s\"", argv[0], argument);
            }
        }
        options->positional[k] = argument;
        return PM_OK;
    }
    const pm_option *option = find(options, argument, &glued);
    if (option == NULL) {
        return pm_fail(PM_EUSAGE, "%s: unknown option \"%s\" (see --help)", argv[0], argument);
    }
    if (option->value == NULL) {
        if (glued != NULL) {
            return pm_fail(PM_EUSAGE, "%s: %s takes no value", argv[0], option->name);
        }
        *option->on = true;
        return PM_OK;
    }
    if (glued == NULL && *i + 1 == argc) {
        return pm_fail(PM_EUSAGE, "%s: %s needs a value (%s)", argv[0], argument, option->value);
    }
    *option->text = glued != NULL ? glued : argv[++*i];
    return PM_OK;
}

pm_status pm_options_read(const pm_options *options, int argc, char **argv, bool *helped) {
    *helped = false;
    for (int i = 1; i < argc; ++i) {
        if (strcmp(argv[i], "--help") == 0 || strcmp(argv[i], "-h") == 0) {
            print_help(options);
            *helped = true;
            return PM_OK;
        }
    }
    for (int i = 1; i < argc; ++i) {
        PM_TRY(take(options, argc, argv, &i));
    }
    if (*options->positional == NULL) {
        return pm_fail(PM_EUSAGE, "%s: %s is missing; usage: %s", argv[0], options->positional_name,
                       options->usage);
    }
    for (int i = 0; i < options->count; ++i) {
        const pm_option *o = &options->option[i];
        if (o->required && *o->text == NULL) {
            return pm_fail(PM_EUSAGE, "%s: %s %s is missing; usage: %s", argv[0], o->name, o->value,
                           options->usage);
        }
    }
    return PM_OK;
}

// Up to `end`: one of `separators`, or the end of the text.
static pm_status read_positive(const char *name, const char *text, const char *separators,
                               char **end, double *result) {
    const double number = strtod(text, end);
    if (*end == text || strchr(separators, **end) == NULL || !(number > 0 && isfinite(number))) {
        return pm_fail(PM_EUSAGE, "%s: expected a number > 0, found \"%s\"", name, text);
    }
    *result = number;
    return PM_OK;
}

pm_status pm_options_positive(const char *name, const char *text, double *result) {
    char *end;
    return read_positive(name, text, "", &end, result);
}

pm_status pm_options_positives(const char *name, const char *text, int most, double *result,
                               int *count) {
    char *end;
    for (*count = 0; *count < most; text = end + 1) {
        PM_TRY(read_positive(name, text, ",", &end, &result[(*count)++]));
        if (*end == '\0') {
            return PM_OK;
        }
    }
    return pm_fail(PM_EUSAGE, "%s: at most %d numbers", name, most);
}

pm_status pm_options_range(const char *text, int count, int *first, int *end) {
    const char *given = text == NULL ? ":" : text;
    char *rest;
    long a = strtol(given, &rest, 10);
    long b = a < count ? a + 1 : a; // "A" alone: one trajectory
    const bool empty = *given == 0 || (rest == given && *rest != ':');
    if (*rest == ':') {
        const char *after = rest + 1;
        b = strtol(after, &rest, 10);
        b = rest == after ? count : b;
    }
    if (empty || *rest != 0 || a < 0 || b > count || a >= b) {
        return pm_fail(PM_EUSAGE, "trajectories \"%s\": expected A:B with 0 <= A < B <= %d", given,
                       count);
    }
    *first = (int)a;
    *end = (int)b;
    return PM_OK;
}

pm_status pm_options_list(const char *text, int count, int *which, int *nwhich) {
    const char *rest = text == NULL ? ":" : text;
    *nwhich = 0;
    while (true) {
        char piece[32];
        const size_t length = strcspn(rest, ",");
        snprintf(piece, sizeof piece, "%.*s", (int)(length < 31 ? length : 31), rest);
        int first = 0, end = 0;
        PM_TRY(pm_options_range(piece, count, &first, &end));
        for (int i = first; i < end; ++i) {
            for (int k = 0; k < *nwhich; ++k) {
                if (which[k] == i) {
                    return pm_fail(PM_EUSAGE, "trajectories \"%s\": %d is named twice", text, i);
                }
            }
            which[(*nwhich)++] = i;
        }
        if (rest[length] == '\0') {
            return PM_OK;
        }
        rest += length + 1;
    }
}

void pm_options_line(int argc, char **argv, char *line, int size) {
    int used = snprintf(line, (size_t)size, "portmet-train");
    for (int i = 0; i < argc && used < size; ++i) {
        used += snprintf(line + used, (size_t)(size - used), " %s", argv[i]);
    }
}

pm_status pm_options_folder(const char *path) {
    char *part = strdup(path);
    if (part == NULL) {
        return pm_fail(PM_ENOMEM, "out of memory for a path");
    }
    for (char *slash = strchr(part, '/'); slash != NULL; slash = strchr(slash + 1, '/')) {
        *slash = 0;
        mkdir(part, 0777); // what fails here shows below
        *slash = '/';
    }
    mkdir(part, 0777);
    free(part);
    return access(path, W_OK | X_OK) == 0
               ? PM_OK
               : pm_fail(PM_EFILE, "%s: cannot make or write this folder", path);
}
